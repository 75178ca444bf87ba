"""The paper's way: strains and pose integrated together from the tip to the base.

One shooting map per anchorage segment, by any integrator of model.integrators, and a jump of the
strains between them. The derivative form carries an error made at the tip to the base multiplied by
D(tip) / D(base), which for a tapered arm is small; from base to tip it would grow by the inverse.
"""

from __future__ import annotations

import logging
from copy import copy
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.errors import NotSettledError
from model.integrators.integrator import Integrator
from model.machine.compiled import compiled
from model.mesh import Mesh
from model.paths import Array
from model.quiet import logged
from model.rotations import IDENTITY, compose, inverse
from model.scene import Scene
from model.segment import Segment
from model.statics import Statics, statics_of
from model.stations import Counts
from model.unloaded.closed_form import base_pose, sections
from model.unloaded.strain_equations import (
    full_strains,
    jump_function,
    section_numbers,
    slope_function,
    state_scale,
)

LOG = logging.getLogger(__name__)


@lru_cache(maxsize=64)
def step_function(statics: Statics, scheme: Integrator, length: float) -> ca.Function:
    """Return (x, numbers d at the scheme's samples, h) -> x across one step of an arm's length."""
    return scheme.stepper(slope_function(statics), state_scale(statics, length))


def step_numbers(
    arm: Arm,
    statics: Statics,
    scheme: Integrator,
    start: Array,
    h: Array,
    active: Counts,
    T: ca.MX,
) -> ca.MX:
    """Return d (n_d, m N) at the scheme's samples in N steps from start by h."""
    s = (start[:, None] + h[:, None] * np.array(scheme.samples)).ravel()
    return section_numbers(arm, statics, s, np.repeat(active, len(scheme.samples)), T)


class StrainSegments:
    """The segments of a scene without loads: x is the pose, then the strains; p the tensions."""

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, scheme: Integrator) -> None:
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.statics = statics_of(scene, arm)
        self.scale = state_scale(self.statics, arm.length)
        self.segments: list[Segment] = []
        outer = 0
        for active in np.unique(mesh.active):
            steps = np.flatnonzero(mesh.active == active)
            nodes = mesh.s[steps[0] : steps[-1] + 2][::-1]
            self.segments.append(self._segment(nodes, outer, int(active)))
            outer = int(active)

    def parameters(self, T: ca.MX) -> ca.MX:
        """See Segments.parameters."""
        return T

    def closure(self, x: ca.MX, p: ca.MX) -> ca.MX:
        """See Segments.closure."""
        return (x[:7] - base_pose(self.arm)) / self.scale[:7]

    def jump(self, s: float, outer: int, inner: int) -> ca.Function:
        """Return (strains on the tip side of s, T) -> strains on its base side."""
        T = ca.MX.sym("T", self.arm.n_tendons)
        strain = ca.MX.sym("strain", len(self.statics.names))
        at = sections(self.arm, self.statics, np.array([s, s]), np.array([outer, inner]))
        pull = at.pull(T)
        after = jump_function(self.statics)(strain, pull[:, 0], pull[:, 1], at.data[:, 1])
        return ca.Function("jump", [strain, T], [after])

    def _segment(self, nodes: Array, outer: int, active: int) -> Segment:
        entry = self._entry(nodes[0], outer, active, nodes[0] == self.mesh.s[-1])
        return Segment(nodes, entry, self._map(nodes, active), self._stretch(nodes, active))

    def _entry(self, s: float, outer: int, inner: int, tip: bool) -> ca.Function:
        x, before = (ca.MX.sym(name, self.scale.size) for name in ("x", "before"))
        T = ca.MX.sym("T", self.arm.n_tendons)
        strain = ca.MX.zeros(self.scale.size - 7) if tip else before[7:]
        rows = x[7:] - self.jump(s, outer, inner)(strain, T)
        joined = rows if tip else ca.vertcat(x[:7] - before[:7], rows)
        return ca.Function("entry", [x, before, T], [joined])

    def _stretch(self, nodes: Array, active: int) -> ca.Function:
        T, x = ca.MX.sym("T", self.arm.n_tendons), ca.MX.sym("x", self.scale.size, nodes.size)
        counts = np.full(nodes.size, active)
        full = full_strains(self.arm, self.scene, nodes, counts, x[7:, :], T)
        return ca.Function("stretch", [x, T], [1 + full[3, :]])

    def _map(self, nodes: Array, active: int) -> ca.Function:
        T, x = ca.MX.sym("T", self.arm.n_tendons), ca.MX.sym("x", self.scale.size)
        h = np.diff(nodes)
        counts = np.full(h.size, active)
        d = step_numbers(self.arm, self.statics, self.scheme, nodes[:-1], h, counts, T)
        step = step_function(self.statics, self.scheme, self.arm.length)
        states = step.mapaccum(h.size)(x, d, ca.DM(h).T)
        return ca.Function("segment", [x, T], [states])


class StrainOde:
    """The forward map by single shooting from the tip, on one mesh: no unknown but the tensions.

    Attributes
    ----------
    function : casadi.Function
        tensions (n_tendons,) -> poses at the mesh's nodes (7, S + 1), 1 + q at the arc lengths
        `stretch_at` (1, K), which `stretch_active` sections cross, and strains on the base side of
        each node (n, S + 1).
    """

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, scheme: Integrator) -> None:
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.order = scheme.order
        T = ca.MX.sym("T", arm.n_tendons)
        x = ca.vertcat(ca.MX(ca.DM(IDENTITY)), ca.MX.zeros(len(statics_of(scene, arm).names)))
        columns, stretches, places, outer = [], [], [], 0
        self.system = StrainSegments(arm, scene, mesh, scheme)
        counts = np.unique(mesh.active).tolist()
        for segment, inner in zip(self.system.segments, counts, strict=True):
            x = ca.vertcat(x[:7], self.system.jump(segment.nodes[0], outer, inner)(x[7:], T))
            states = ca.horzcat(x, segment.map(x, T))
            columns.append(states[:, :-1])
            stretches.append(segment.stretch(states, T))
            places.append(segment.nodes)
            x, outer = states[:, -1], inner
        states = ca.horzcat(*columns, x)[:, ::-1]
        self.stretch_at = np.concatenate(places)
        counts = [place.size for place in places]
        self.stretch_active = np.repeat(np.unique(mesh.active), counts)
        outputs = [self._anchored(states), ca.horzcat(*stretches), states[7:, :]]
        self.function = ca.Function("strain_ode", [T], outputs)

    def _anchored(self, states: ca.MX) -> ca.MX:
        """Return the poses in the base frame from those in the tip's."""
        first, here = ca.SX.sym("first", 7), ca.SX.sym("here", 7)
        pose = compose(compose(ca.SX(ca.DM(base_pose(self.arm))), inverse(first)), here)
        anchor = ca.Function("anchor", [first, here], [pose])
        return anchor.map(states.shape[1])(states[:7, 0], states[:7, :])

    def compiled(self) -> StrainOde:
        """See ExplicitMap.compiled."""
        other = copy(self)
        other.function = compiled(self.function)
        return other

    def run(self, tensions: Array, near: object = None) -> tuple[Array, Array]:
        """See ForwardMap.run: poses and strains (S + 1, 7 + n), and 1 + q (K,).

        Raises NotSettledError where the scheme fails on a step.
        """
        try:
            with logged(LOG):  # an implicit step that fails is told with all its numbers
                poses, stretch, strains = self.function(tensions)
        except RuntimeError as error:
            remedy = "ask for less accuracy, lower the tensions, or name another scheme"
            raise NotSettledError(
                0.0, np.inf, f"{self.scheme.name} failed on a step: {remedy}"
            ) from error
        return np.array(ca.vertcat(poses, strains)).T, np.array(stretch).ravel()

    def known(self, states: Array) -> None:
        """See ForwardMap.known: nothing, the map is explicit."""

    def dense(self, tensions: Array, states: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes above."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, start = self.mesh.active[step], self.mesh.s[step + 1]
        T = ca.MX.sym("T", self.arm.n_tendons)
        statics = statics_of(self.scene, self.arm)
        d = step_numbers(self.arm, statics, self.scheme, start, s - start, active, T)
        across = step_function(statics, self.scheme, self.arm.length).map(s.size)
        x = across(ca.DM(states[step + 1].T), d, ca.DM(s - start).T)
        strains = full_strains(self.arm, self.scene, s, active, x[7:, :], T)
        values = ca.Function("dense", [T], [x[:7, :], strains])(tensions)
        return np.array(values[0]).T, np.array(values[1]).T
