"""The fast path: strains in closed form, poses by Magnus steps from the base.

Data flow: tensions -> sums over tendons at the steps' nodes (one sparse linear map) -> strains
(closed form) -> one relative pose per step (Magnus) -> poses at the nodes (products from the base).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.magnus import Magnus
from model.mesh import Mesh
from model.paths import Array
from model.rotations import compose, from_matrix
from model.scene import Scene
from model.statics import ClosedStatics, LoadedStatics, Statics, statics_of
from model.statics.base import curvature
from model.stations import Counts, stations


def base_pose(arm: Arm) -> Array:
    """Return the clamped pose (7,) of the arm's base."""
    return np.concatenate([from_matrix(np.array(arm.base_frame)), arm.base_position])


def closed_statics(scene: Scene, arm: Arm) -> ClosedStatics:
    """Return the scene's statics, which have to be in closed form."""
    statics = statics_of(scene, arm)
    assert isinstance(statics, ClosedStatics)
    return statics


@lru_cache(maxsize=64)
def strain_function(statics: ClosedStatics) -> ca.Function:
    """Return (pull, data) -> (tau, xi, k, q) at one cross-section."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    strain = statics.solve(pull, data)
    full = full_strain(statics, strain, pull, data)
    return ca.Function("strain", [pull, data], [full], {"cse": True})


def full_strain(statics: Statics, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
    """Return (tau, xi, k, q) from the strains that the statics carry."""
    q = statics.stretch(strain, pull, data)
    return ca.vertcat(curvature(statics.names, strain), q)


@lru_cache(maxsize=64)
def step_function(scheme: Magnus) -> ca.Function:
    """Return (strains (4, m), h) -> relative pose (7,) of a step."""
    m = len(scheme.nodes)
    strains, h = ca.SX.sym("strains", 4, m), ca.SX.sym("h")
    pose = scheme.step([twist(strains[:, i]) for i in range(m)], h)
    return ca.Function("step", [strains, h], [pose], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def _chain() -> ca.Function:
    g, h = ca.SX.sym("g", 7), ca.SX.sym("h", 7)
    product = compose(g, h)
    return ca.Function("chain", [g, h], [product, product])


@dataclass(frozen=True, eq=False)
class Sections:
    """What statics take from N cross-sections.

    Attributes
    ----------
    map, map_rate : (n_pull N, n_tendons)
        From tensions to pull, and its derivative along s.
    data, data_rate : (n_data, N)
        Numbers of body and tendon paths, and their derivatives along s.
    """

    map: ca.DM
    map_rate: ca.DM
    data: ca.DM
    data_rate: ca.DM

    def pull(self, T: ca.MX) -> ca.MX:
        """Return pull (n_pull, N) of tensions (n_tendons,)."""
        return ca.reshape(self.map @ T, -1, self.data.shape[1])

    def pull_rate(self, T: ca.MX) -> ca.MX:
        """Return the derivative of pull along s (n_pull, N)."""
        return ca.reshape(self.map_rate @ T, -1, self.data.shape[1])


def sections(arm: Arm, statics: Statics | LoadedStatics, s: Array, active: Counts) -> Sections:
    """Return what statics take from the cross-sections at s (N,)."""
    at = stations(arm, s, active)
    maps = [ca.sparsify(ca.DM(m.reshape(-1, arm.n_tendons))) for m in statics.pulls(arm, at)]
    return Sections(*maps, *(ca.DM(values) for values in statics.data(at)))


def strains_at(arm: Arm, scene: Scene, s: Array, active: Counts, T: ca.MX) -> ca.MX:
    """Return the strains (4, N), rows tau, xi, k, q, at stations s as an expression of tensions."""
    statics = closed_statics(scene, arm)
    at = sections(arm, statics, s, active)
    return strain_function(statics).map(s.size)(at.pull(T), at.data)


def nodes_of(scheme: Magnus, left: Array, right: Array) -> Array:
    """Return the arc lengths (m N,) of a scheme's nodes in N steps."""
    return np.ravel(left[:, None] + (right - left)[:, None] * np.array(scheme.nodes))


class ClosedForm:
    """The forward map of an unloaded scene with closed-form strains, on one mesh.

    Attributes
    ----------
    function : casadi.Function
        tensions (n_tendons,) -> poses at the mesh's nodes (7, S + 1), and 1 + q at the arc lengths
        `stretch_at` (1, K), the scheme's nodes in the steps and both ends of each segment, which
        `stretch_active` sections cross.
    """

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, scheme: Magnus) -> None:
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.order = scheme.order
        T = ca.MX.sym("T", arm.n_tendons)
        relative, strains = self._steps(mesh.s[:-1], mesh.s[1:], mesh.active, T)
        chain = _chain().mapaccum(mesh.steps)
        base = base_pose(arm)
        poses = ca.horzcat(base, chain(base, relative)[1])
        ends, active = mesh.segment_ends()
        stretch = 1 + ca.horzcat(strains[3, :], strains_at(arm, scene, ends, active, T)[3, :])
        self.stretch_at = np.concatenate([nodes_of(scheme, mesh.s[:-1], mesh.s[1:]), ends])
        self.stretch_active = np.concatenate([np.repeat(mesh.active, len(scheme.nodes)), active])
        self.function = ca.Function("closed_form", [T], [poses, stretch])

    def _steps(self, left: Array, right: Array, active: Counts, T: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the relative poses (7, N) and strains (4, m N) of N steps."""
        m = len(self.scheme.nodes)
        s = nodes_of(self.scheme, left, right)
        strains = strains_at(self.arm, self.scene, s, np.repeat(active, m), T)
        relative = step_function(self.scheme).map(left.size)(strains, ca.DM(right - left).T)
        return relative, strains

    def run(self, tensions: Array, near: Array | None = None) -> Array:
        """Return the poses (S + 1, 7) at the nodes for tensions (n_tendons,)."""
        return np.array(self.function(tensions)[0]).T

    def starts(self, states: Array) -> None:
        """See ForwardMap.starts: nothing, the map is explicit."""

    def stretch(self, tensions: Array, states: Array) -> Array:
        """See ForwardMap.stretch."""
        return np.array(self.function(tensions)[1]).ravel()

    def dense(self, tensions: Array, poses: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active = self.mesh.active[step]
        T = ca.MX.sym("T", self.arm.n_tendons)
        relative, _ = self._steps(self.mesh.s[step], s, active, T)
        start = ca.DM(poses[step].T)
        pose = _chain().map(s.size)(start, relative)[0]
        strain = strains_at(self.arm, self.scene, s, active, T)
        values = ca.Function("dense", [T], [pose, strain])(tensions)
        return np.array(values[0]).T, np.array(values[1]).T
