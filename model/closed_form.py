"""The fast path: strains in closed form, poses by Magnus steps from the base.

Data flow: tensions -> sums over tendons at the steps' nodes (one sparse linear map) -> strains
(closed form) -> one relative pose per step (Magnus) -> poses at the nodes (products from the base).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.magnus import Magnus
from model.mesh import Mesh
from model.paths import Array
from model.rotations import compose, from_matrix
from model.scene import Scene
from model.statics import ClosedStatics, statics_of
from model.statics.base import curvature
from model.stations import Counts, pulls, stations


def base_pose(arm: Arm) -> Array:
    """Return the clamped pose (7,) of the arm's base."""
    return np.concatenate([from_matrix(np.array(arm.base_frame)), arm.base_position])


def closed_statics(scene: Scene) -> ClosedStatics:
    """Return the scene's statics, which have to be in closed form."""
    statics = statics_of(scene)
    assert isinstance(statics, ClosedStatics)
    return statics


@lru_cache(maxsize=64)
def strain_function(scene: Scene) -> ca.Function:
    """Return (pull (6,), body (3,)) -> (tau, xi, k, q) at one cross-section."""
    statics = closed_statics(scene)
    pull, body = ca.SX.sym("pull", 6), ca.SX.sym("body", 3)
    strain = statics.solve(pull, body, ca.SX.zeros(len(statics.names)))
    q = statics.stretch(strain, pull, body)
    return ca.Function("strain", [pull, body], [ca.vertcat(curvature(statics.names, strain), q)])


@lru_cache(maxsize=64)
def step_function(scene: Scene, scheme: Magnus) -> ca.Function:
    """Return (pulls (6, m), bodies (3, m), h) -> relative pose (7,), strains (4, m), of a step."""
    strain, m = strain_function(scene), len(scheme.nodes)
    pull, body, h = ca.SX.sym("pull", 6, m), ca.SX.sym("body", 3, m), ca.SX.sym("h")
    strains = [strain(pull[:, i], body[:, i]) for i in range(m)]
    pose = scheme.step([twist(e) for e in strains], h)
    return ca.Function("step", [pull, body, h], [pose, ca.horzcat(*strains)], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def _chain() -> ca.Function:
    g, h = ca.SX.sym("g", 7), ca.SX.sym("h", 7)
    product = compose(g, h)
    return ca.Function("chain", [g, h], [product, product])


def pull_map(arm: Arm, s: Array, active: Counts) -> ca.DM:
    """Return the linear map (6 N, n_tendons) from tensions to the sums at N stations."""
    rows = pulls(arm, stations(arm, s, active))[0]
    return ca.sparsify(ca.DM(rows.reshape(-1, arm.n_tendons)))


def strains_at(arm: Arm, scene: Scene, s: Array, active: Counts, T: ca.MX) -> ca.MX:
    """Return the strains (4, N), rows tau, xi, k, q, at stations s as an expression of tensions."""
    pull = ca.reshape(pull_map(arm, s, active) @ T, 6, s.size)
    body = ca.DM(stations(arm, s, active).body)
    return strain_function(scene).map(s.size)(pull, body)


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
        h = right - left
        s = nodes_of(self.scheme, left, right)
        active = np.repeat(active, len(self.scheme.nodes))
        pull = ca.reshape(pull_map(self.arm, s, active) @ T, 6, s.size)
        body = ca.DM(stations(self.arm, s, active).body)
        relative, strains = step_function(self.scene, self.scheme).map(h.size)(
            pull, body, ca.DM(h).T
        )
        return relative, strains

    def run(self, tensions: Array) -> Array:
        """Return the poses (S + 1, 7) at the nodes for tensions (n_tendons,)."""
        return np.array(self.function(tensions)[0]).T

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
