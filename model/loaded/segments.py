"""The stretches between anchorages and loads of a loaded arm, on one mesh."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import TipLoad
from model.integrators.runge_kutta import RungeKutta
from model.loaded.functions import jump_function, load_step, strain_reader, tip_function
from model.loaded.loads import places
from model.loaded.sections import LoadSections
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.segment import Segment
from model.unloaded.closed_form import base_pose


class LoadSegments(LoadSections):
    """See Segments.

    With a `probe` a small force and moment can act there, and with `lengths` those of the tendons
    are states: what stiffness asks for.

    Attributes
    ----------
    base : (7,)
        The clamped pose.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        mesh: Mesh,
        scheme: RungeKutta,
        probe: float | None = None,
        lengths: bool = False,
    ) -> None:
        super().__init__(arm, scene, scheme, probe, lengths)
        self.mesh, self.base, L = mesh, ca.DM(base_pose(arm)), arm.length
        rest = self.equations.n_x - 10
        self.scale = np.array([1.0] * 4 + [L] * 3 + [1 / L] * 3 + [1.0] * rest)
        cuts = self._cuts()
        self.segments = [self._segment(nodes, i == 0) for i, nodes in enumerate(cuts)]

    def parameters(self, T: ca.MX, share: ca.MX | float = 1.0) -> ca.MX:
        """See Segments.parameters; `share` of the loads."""
        return ca.vertcat(T, share, ca.MX.zeros(self.n_p - self.arm.n_tendons - 1))

    def p(self, tensions: Array, share: float = 1.0) -> Array:
        """Return the parameters as numbers; see parameters."""
        return np.concatenate([tensions, [share], np.zeros(self.n_p - tensions.size - 1)])

    def closure(self, x: ca.MX, p: ca.MX) -> ca.MX:
        """See Segments.closure: the pose of the base, and the motors' tensions with friction."""
        pose = (x[:7] - self.base) / self.scale[:7]
        return ca.vertcat(pose, x[self.equations.tensions] - p[: self.equations.n_tension])

    def stretch(self, nodes: Array, active: int, beyond: float) -> ca.Function:
        """Return (x (n_x, N), p) -> 1 + q at nodes of a segment; see sections."""
        x, p = self._symbols(nodes.size)
        here = self.sections(nodes, np.full(nodes.size, active), beyond, p)
        full = strain_reader(self.equations).map(nodes.size)(x, *here.still)
        return ca.Function("stretch", [x, p], [1 + full[3, :]])

    def _cuts(self) -> list[Array]:
        """Return the nodes of each segment, tip side first."""
        ends = {section.at for section in self.arm.sections} | {*places(self.arm, self.scene)}
        ends |= {self.probe} if self.probe is not None else set()
        inner = sorted({self.mesh.node(s) for s in ends} - {0, self.mesh.steps}, reverse=True)
        bounds = [self.mesh.steps, *inner, 0]
        pairs = pairwise(bounds)
        return [self.mesh.s[low : high + 1][::-1] for high, low in pairs]

    def _segment(self, nodes: Array, first: bool) -> Segment:
        active = self.active(nodes[:2].mean())
        return Segment(
            nodes,
            self._tip(nodes, active) if first else self._jump(nodes, active),
            self._map(nodes),
            self.stretch(nodes, active, nodes[0]),
        )

    def _symbols(self, *columns: int) -> tuple[ca.MX, ...]:
        """Return states of so many columns each, and p."""
        states = [ca.MX.sym(f"x{i}", self.equations.n_x, m) for i, m in enumerate(columns)]
        return (*states, ca.MX.sym("p", self.n_p))

    def _tip(self, nodes: Array, active: int) -> ca.Function:
        x, before, p = self._symbols(1, 1)
        tip = self.scene.find(TipLoad)
        load = np.concatenate([tip.force, tip.moment]) if tip else np.zeros(6)
        here = self.sections(nodes[:1], np.array([active]), nodes[0], p)
        share = p[self.arm.n_tendons]
        moment = self.moment(nodes[0], p)
        rows = tip_function(self.equations)(x, *here.still, share * ca.DM(load), moment)
        return ca.Function("tip", [x, before, p], [rows])

    def _jump(self, nodes: Array, active: int) -> ca.Function:
        x, before, p = self._symbols(1, 1)
        s, L = nodes[:1], self.arm.length
        outside = self.active(min(nodes[0] + 1e-9 * L, L))
        outer = self.sections(s, np.array([outside]), nodes[0] + 1e-6 * L, p)
        inner = self.sections(s, np.array([active]), nodes[0], p)
        moment = self.moment(nodes[0], p)
        rows = jump_function(self.equations)(before, *outer.still, x, *inner.still, moment)
        return ca.Function("jump", [x, before, p], [rows])

    def _map(self, nodes: Array) -> ca.Function:
        x, p = self._symbols(1)
        step = load_step(self.equations, self.scheme)
        states = step.mapaccum(nodes.size - 1)(x, *self.steps(nodes, p))
        return ca.Function("segment", [x, p], [states])
