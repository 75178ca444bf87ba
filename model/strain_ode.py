"""The paper's way: strains and pose integrated together from the tip to the base.

One shooting map per anchorage segment, by Runge-Kutta, and a jump of the strains between them. The
derivative form carries an error made at the tip to the base multiplied by D(tip) / D(base), which
for a tapered arm is small; from base to tip it would grow by the inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.closed_form import base_pose, full_strain, sections
from model.mesh import Mesh
from model.paths import Array
from model.rotations import IDENTITY, compose, inverse, multiply, rotate
from model.runge_kutta import RungeKutta
from model.scene import Scene
from model.statics import Statics, statics_of
from model.statics.base import curvature
from model.stations import Counts


@lru_cache(maxsize=64)
def step_function(statics: Statics, scheme: RungeKutta) -> ca.Function:
    """Return (x, pulls, pull rates, data, data rates, h) -> x across one step.

    The state x is the pose (7,) and the strains; the other arguments have a column for each
    distinct node of the scheme.
    """
    nodes = sorted(set(scheme.nodes))
    m, n = len(nodes), len(statics.names)
    x, h = ca.SX.sym("x", 7 + n), ca.SX.sym("h")
    pull, pull_rate = (ca.SX.sym(name, statics.n_pull, m) for name in ("pull", "pull_rate"))
    data, data_rate = (ca.SX.sym(name, statics.n_data, m) for name in ("data", "data_rate"))
    slope = _slope(statics)

    def rate(stage: int, x: ca.SX) -> ca.SX:
        i = nodes.index(scheme.nodes[stage])
        return slope(x, pull[:, i], data[:, i], pull_rate[:, i], data_rate[:, i])

    args = [x, pull, pull_rate, data, data_rate, h]
    return ca.Function("step", args, [scheme.step(rate, x, h)], {"cse": True})


@lru_cache(maxsize=64)
def _slope(statics: Statics) -> ca.Function:
    """Return (x, pull, data, pull rate, data rate) -> derivative of x along s."""
    x = ca.SX.sym("x", 7 + len(statics.names))
    pull, pull_rate = (ca.SX.sym(name, statics.n_pull) for name in ("pull", "pull_rate"))
    data, data_rate = (ca.SX.sym(name, statics.n_data) for name in ("data", "data_rate"))
    strain_rate = statics.rate(x[7:], pull, data, pull_rate, data_rate)
    slope = ca.vertcat(pose_rate(statics, x, pull, data), strain_rate)
    return ca.Function("slope", [x, pull, data, pull_rate, data_rate], [slope], {"cse": True})


def pose_rate(statics: Statics, x: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
    """Return the derivative (7,) of the pose along s, eq. (1)."""
    stretch = 1 + statics.stretch(x[7:], pull, data)
    kappa = stretch * curvature(statics.names, x[7:])
    turn = multiply(x[:4], ca.vertcat(0, kappa)) / 2
    return ca.vertcat(turn, rotate(x[:4], ca.vertcat(stretch, 0, 0)))


@lru_cache(maxsize=64)
def jump_function(statics: Statics) -> ca.Function:
    """Return (strain on the tip side, outer pull, inner pull, data) -> strain on the base side."""
    strain = ca.SX.sym("strain", len(statics.names))
    outer, inner = (ca.SX.sym(name, statics.n_pull) for name in ("outer", "inner"))
    data = ca.SX.sym("data", statics.n_data)
    jump = statics.jump(strain, outer, inner, data)
    return ca.Function("jump", [strain, outer, inner, data], [jump], {"cse": True})


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch of the arm between two anchorages, with the functions that carry a state across.

    Attributes
    ----------
    nodes : (N + 1,)
        Mesh nodes from the tip side to the base side [m].
    jump : casadi.Function
        (strains on the tip side of its first node, T) -> strains on the base side.
    map : casadi.Function
        (x at the first node, T) -> x at all further nodes (7 + n, N); x is pose, then strains.
    stretch : casadi.Function
        (strains at the nodes (n, N + 1), T) -> 1 + q there (1, N + 1).
    """

    nodes: Array
    jump: ca.Function
    map: ca.Function
    stretch: ca.Function


def segments(arm: Arm, scene: Scene, mesh: Mesh, scheme: RungeKutta) -> list[Segment]:
    """Return the segments from tip to base."""
    result = []
    outer = 0
    for active in np.unique(mesh.active):
        steps = np.flatnonzero(mesh.active == active)
        nodes = mesh.s[steps[0] : steps[-1] + 2][::-1]
        jump = _jump(arm, scene, nodes[0], outer, int(active))
        across = _segment_map(arm, scene, scheme, nodes, int(active))
        result.append(Segment(nodes, jump, across, _stretch(arm, scene, nodes, int(active))))
        outer = int(active)
    return result


def _jump(arm: Arm, scene: Scene, s: float, outer: int, inner: int) -> ca.Function:
    statics = statics_of(scene, arm)
    T = ca.MX.sym("T", arm.n_tendons)
    strain = ca.MX.sym("strain", len(statics.names))
    at = sections(arm, statics, np.array([s, s]), np.array([outer, inner]))
    pull = at.pull(T)
    after = jump_function(statics)(strain, pull[:, 0], pull[:, 1], at.data[:, 1])
    return ca.Function("jump", [strain, T], [after])


def _stretch(arm: Arm, scene: Scene, nodes: Array, active: int) -> ca.Function:
    T = ca.MX.sym("T", arm.n_tendons)
    strains = ca.MX.sym("strains", len(statics_of(scene, arm).names), nodes.size)
    full = full_strains(arm, scene, nodes, np.full(nodes.size, active), strains, T)
    return ca.Function("stretch", [strains, T], [1 + full[3, :]])


def _segment_map(
    arm: Arm, scene: Scene, scheme: RungeKutta, nodes: Array, active: int
) -> ca.Function:
    statics = statics_of(scene, arm)
    step = step_function(statics, scheme)
    T, x = ca.MX.sym("T", arm.n_tendons), ca.MX.sym("x", step.size1_in(0))
    h = np.diff(nodes)
    data = _node_data(arm, statics, scheme, nodes[:-1], h, np.full(h.size, active), T)
    states = step.mapaccum(h.size)(x, *data, ca.DM(h).T)
    return ca.Function("segment", [x, T], [states])


def _node_data(
    arm: Arm,
    statics: Statics,
    scheme: RungeKutta,
    start: Array,
    h: Array,
    active: Counts,
    T: ca.MX,
) -> tuple[ca.MX | ca.DM, ...]:
    """Return pulls, pull rates, data and data rates at the nodes of steps from start by h."""
    c = np.array(sorted(set(scheme.nodes)))
    s = (start[:, None] + h[:, None] * c).ravel()
    at = sections(arm, statics, s, np.repeat(active, c.size))
    return at.pull(T), at.pull_rate(T), at.data, at.data_rate


class StrainOde:
    """The forward map by single shooting from the tip, on one mesh: no unknown but the tensions.

    Attributes
    ----------
    function : casadi.Function
        tensions (n_tendons,) -> poses at the mesh's nodes (7, S + 1), 1 + q at the arc lengths
        `stretch_at` (1, K), which `stretch_active` sections cross, and strains on the base side of
        each node (n, S + 1).
    """

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, scheme: RungeKutta) -> None:
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.order = scheme.order
        T = ca.MX.sym("T", arm.n_tendons)
        x = ca.vertcat(ca.MX(ca.DM(IDENTITY)), ca.MX.zeros(len(statics_of(scene, arm).names)))
        columns, stretches, places = [], [], []
        for segment in segments(arm, scene, mesh, scheme):
            x = ca.vertcat(x[:7], segment.jump(x[7:], T))
            states = ca.horzcat(x, segment.map(x, T))
            columns.append(states[:, :-1])
            stretches.append(segment.stretch(states[7:, :], T))
            places.append(segment.nodes)
            x = states[:, -1]
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

    def run(self, tensions: Array) -> Array:
        """Return poses and strains (S + 1, 7 + n) at the nodes for tensions (n_tendons,)."""
        poses, _, strains = self.function(tensions)
        return np.array(ca.vertcat(poses, strains)).T

    def dense(self, tensions: Array, states: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes above."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, start = self.mesh.active[step], self.mesh.s[step + 1]
        T = ca.MX.sym("T", self.arm.n_tendons)
        statics = statics_of(self.scene, self.arm)
        data = _node_data(self.arm, statics, self.scheme, start, s - start, active, T)
        across = step_function(statics, self.scheme).map(s.size)
        x = across(ca.DM(states[step + 1].T), *data, ca.DM(s - start).T)
        strains = full_strains(self.arm, self.scene, s, active, x[7:, :], T)
        values = ca.Function("dense", [T], [x[:7, :], strains])(tensions)
        return np.array(values[0]).T, np.array(values[1]).T


def full_strains(
    arm: Arm, scene: Scene, s: Array, active: Counts, strains: ca.MX, T: ca.MX
) -> ca.MX:
    """Return (tau, xi, k, q) (4, N) at stations s from the strains that are states there (n, N)."""
    statics = statics_of(scene, arm)
    at = sections(arm, statics, s, active)
    return _full_strain_function(statics).map(s.size)(strains, at.pull(T), at.data)


@lru_cache(maxsize=64)
def _full_strain_function(statics: Statics) -> ca.Function:
    strain = ca.SX.sym("strain", len(statics.names))
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    full = full_strain(statics, strain, pull, data)
    return ca.Function("full_strain", [strain, pull, data], [full])
