"""The stretches between anchorages and loads of a loaded arm, on one mesh.

Parameters p are the tensions at the motors (n_tendons,), the share of the loads that acts, and with
a probe a further dead force and moment (6,) there, in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from model.arm import Arm
from model.closed_form import base_pose
from model.effects import TipLoad
from model.load_equations import (
    LoadEquations,
    jump_function,
    load_step,
    strain_reader,
    tip_function,
)
from model.loads import load_form, load_numbers, places
from model.mesh import Mesh
from model.paths import Array
from model.runge_kutta import RungeKutta
from model.scene import Scene
from model.segment import Segment
from model.statics import loaded_statics_of
from model.stations import Counts, Stations, stations


def load_equations(
    arm: Arm, scene: Scene, probed: bool = False, lengths: bool = False
) -> LoadEquations:
    """Return the equations of a loaded scene."""
    section = tuple(i for i, _ in arm.tendons)
    form = load_form(arm, scene, probed, lengths)
    return LoadEquations(loaded_statics_of(scene, arm), form, section)


@dataclass(frozen=True, eq=False)
class Sections:
    """What the equations take from N cross-sections, as expressions of p: a column for each."""

    pull: ca.MX
    data: ca.DM
    pull_rate: ca.MX
    data_rate: ca.DM
    numbers: ca.MX

    @property
    def still(self) -> tuple[ca.MX, ca.DM, ca.MX]:
        """What is not a rate: pull, data, numbers."""
        return self.pull, self.data, self.numbers

    @property
    def all(self) -> tuple[ca.MX, ca.DM, ca.MX, ca.DM, ca.MX]:
        """Everything, in the order of LoadEquations.symbols."""
        return self.pull, self.data, self.pull_rate, self.data_rate, self.numbers


class LoadSegments:
    """See Segments.

    Attributes
    ----------
    equations : LoadEquations
    base : (7,)
        The clamped pose.
    probe : float or None
        Where a further force and moment may act [m].
    n_p : int
        Size of the parameters.
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
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.probe, self.base = probe, ca.DM(base_pose(arm))
        self.equations = load_equations(arm, scene, probe is not None, lengths)
        self.n_p = arm.n_tendons + 1 + 6 * (probe is not None)
        L, e = arm.length, self.equations
        rest = e.n_x - 10
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
        n = self.equations.n_tension
        return ca.vertcat(pose, x[self.tensions] - p[:n])

    @property
    def tensions(self) -> slice:
        """Where the tensions are in a state."""
        start = 7 + self.equations.statics.size + self.equations.n_force
        return slice(start, start + self.equations.n_tension)

    def sections(self, s: Array, active: Counts, beyond: float, p: ca.MX) -> Sections:
        """Return what the equations take from sections at s (N,)."""
        at = stations(self.arm, s, active)
        statics, n = self.equations.statics, self.arm.n_tendons
        T, share = p[:n], p[n]
        pulls = []
        for maps in statics.pulls(self.arm, at):
            if self.equations.n_tension:
                columns = np.transpose(maps, (2, 1, 0)).reshape(-1, s.size)
                pulls.append(ca.MX(ca.DM(columns)))
            else:
                flat = ca.sparsify(ca.DM(maps.reshape(-1, n)))
                pulls.append(ca.reshape(flat @ T, -1, s.size))
        data, data_rate = (ca.DM(values) for values in statics.data(at))
        return Sections(pulls[0], data, pulls[1], data_rate, self._numbers(at, beyond, share, p))

    def _numbers(self, at: Stations, beyond: float, share: ca.MX, p: ca.MX) -> ca.MX:
        rows = load_numbers(self.arm, self.scene, self.equations.form, at, beyond)
        scaled = ("force", "density", "drag", "mu")
        parts = [ca.DM(v) * share if name in scaled else ca.DM(v) for name, v in rows.items()]
        if self.reaches(beyond):
            parts[0] = parts[0] + ca.repmat(p[-6:-3], 1, at.s.size)
        return ca.vertcat(*parts) if parts else ca.MX(0, at.s.size)

    def reaches(self, s: float) -> bool:
        """Return whether the probe pulls on what is on the base side of s."""
        return self.probe is not None and s <= self.probe + 1e-9 * self.arm.length

    def _moment(self, s: float, p: ca.MX) -> ca.MX:
        """Return the probe's moment if it acts at s, zero if it acts elsewhere."""
        if self.probe is None:
            return ca.MX(0, 1)
        here = abs(s - self.probe) <= 1e-9 * self.arm.length
        return p[-3:] if here else ca.MX.zeros(3)

    def _cuts(self) -> list[Array]:
        """Return the nodes of each segment, tip side first."""
        ends = {section.at for section in self.arm.sections} | {*places(self.arm, self.scene)}
        ends |= {self.probe} if self.probe is not None else set()
        inner = sorted({self.mesh.node(s) for s in ends} - {0, self.mesh.steps}, reverse=True)
        bounds = [self.mesh.steps, *inner, 0]
        pairs = pairwise(bounds)
        return [self.mesh.s[low : high + 1][::-1] for high, low in pairs]

    def active(self, s: float) -> int:
        """Return how many sections' tendons cross just beyond s."""
        return sum(section.at > s for section in self.arm.sections)

    def _segment(self, nodes: Array, first: bool) -> Segment:
        active = self.active((nodes[0] + nodes[1]) / 2)
        return Segment(
            nodes,
            self._tip(nodes, active) if first else self._jump(nodes, active),
            self._map(nodes, active),
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
        moment = self._moment(nodes[0], p)
        rows = tip_function(self.equations)(x, *here.still, share * ca.DM(load), moment)
        return ca.Function("tip", [x, before, p], [rows])

    def _jump(self, nodes: Array, active: int) -> ca.Function:
        x, before, p = self._symbols(1, 1)
        s, L = nodes[:1], self.arm.length
        outside = self.active(min(nodes[0] + 1e-9 * L, L))
        outer = self.sections(s, np.array([outside]), nodes[0] + 1e-6 * L, p)
        inner = self.sections(s, np.array([active]), nodes[0], p)
        moment = self._moment(nodes[0], p)
        rows = jump_function(self.equations)(before, *outer.still, x, *inner.still, moment)
        return ca.Function("jump", [x, before, p], [rows])

    def _map(self, nodes: Array, active: int) -> ca.Function:
        x, p = self._symbols(1)
        h = np.diff(nodes)
        data = self.step_data(nodes[:-1], h, np.full(h.size, active), nodes[0], p)
        step = load_step(self.equations, self.scheme)
        states = step.mapaccum(h.size)(x, *data, ca.DM(h).T)
        return ca.Function("segment", [x, p], [states])

    def step_data(
        self, start: Array, h: Array, active: Counts, beyond: float, p: ca.MX
    ) -> tuple[ca.MX | ca.DM, ...]:
        """Return what steps from start (N,) by h (N,) take from the sections at their nodes."""
        c = np.array(sorted(set(self.scheme.nodes)))
        s = (start[:, None] + h[:, None] * c).ravel()
        return self.sections(s, np.repeat(active, c.size), beyond, p).all

    def stretch(self, nodes: Array, active: int, beyond: float) -> ca.Function:
        """Return (x (n_x, N), p) -> 1 + q at nodes of a segment; see sections."""
        x, p = self._symbols(nodes.size)
        here = self.sections(nodes, np.full(nodes.size, active), beyond, p)
        full = strain_reader(self.equations).map(nodes.size)(x, *here.still)
        return ca.Function("stretch", [x, p], [1 + full[3, :]])
