"""The lengths of the tendons of an arm without loads, as a function of the tensions.

Data flow: tensions -> strains of the cross-sections (closed form) -> lengths of the tendons by
quadrature, and their derivatives: of the lengths by the strains, of these by the tensions through
the implicit function theorem on the balance of each cross-section.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section.law import CrossSection, size
from model.errors import UnsettledSectionError
from model.machine.buffered import Buffered
from model.machine.compiled import kernels
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.stations import crossing, stations, tendon_paths
from model.transcription.collocation import gauss
from model.unloaded.closed_form import pull_at, strain_function, unloaded
from model.unloaded.statics import ClosedStatics, closed_statics

# Strains are analytic between nodes: so many Gauss points on the coarsest mesh leave rounding only,
# whatever mesh poses have. Measured on the paper's arms and random ones at thrice their tensions.
_POINTS = 8
# So few leave 1e-7 of the arm's length at most, of tensions mostly less than 1e-5: to begin with.
FEW = 3


class Lengths(NamedTuple):
    """Tendons under tensions.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    lengths : (n_tendons,)
        [m].
    by_tensions : (n_tendons, n_tendons)
        How the lengths change with the tensions [m/N].
    """

    tensions: Array
    lengths: Array
    by_tensions: Array


class TendonLengths:
    """Tensions to lengths of the tendons, by Gauss quadrature with `points` in each step."""

    def __init__(
        self, arm: Arm, scene: Scene, machine_code: bool = False, points: int = _POINTS
    ) -> None:
        mesh, method = graded(arm, 1), gauss(points)
        scene, h = unloaded(scene), np.diff(mesh.s)
        statics = closed_statics(scene, arm)
        self.s = (mesh.s[:-1, None] + h[:, None] * method.c).ravel()
        active, weights = np.repeat(mesh.active, points), np.outer(h, method.b).ravel()
        at = stations(arm, self.s, active)
        place, tendon = np.nonzero(crossing(arm, at))
        self._maps, self._shape = statics.pulls(arm, at), (self.s.size, arm.n_tendons)
        paths, weight = np.zeros((*self._shape, 4)), np.zeros(self._shape)
        paths[place, tendon] = tendon_paths(arm, at, place, tendon).T
        weight[place, tendon] = weights[place]

        T = ca.MX.sym("T", arm.n_tendons)
        pull, data = pull_at(arm, statics, self.s, active, T)
        functions = [strain_function(statics), _by_pull(statics), _runs(statics.law, T.numel())]
        strain, by_pull, runs = kernels(functions, machine_code)
        strains = strain.map(self.s.size)(pull, data)
        v, slopes = by_pull.map(self.s.size)(strains, pull, data)
        lengths = runs.map(self.s.size)(v, paths.reshape(self.s.size, -1).T, weight.T)
        self._call = Buffered(
            ca.Function("tendon_lengths", [T], [ca.sum2(lengths[0]), lengths[1], slopes])
        )
        self._robust: Callable[[], TendonLengths] | None = None
        if scene.robust() != scene:
            self._robust = partial(tendon_lengths, arm, scene.robust(), machine_code, points)

    def __call__(self, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,); raises UnsettledSectionError."""
        lengths, by_strains, slopes = self._call(tensions)
        if np.isnan(lengths.sum()):
            if self._robust is not None:
                return self._robust()(tensions)
            lost = np.isnan(slopes).any(axis=1)
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        N, n_tendons = self._shape
        moved = slopes.reshape(N, self._maps.shape[1], -1).transpose(0, 2, 1) @ self._maps
        # (n_tendons, n) of each cross-section, column by column.
        by_strains = by_strains.reshape(-1, n_tendons).T
        by_tensions = by_strains @ moved.reshape(-1, n_tendons)
        return Lengths(tensions, lengths[0], by_tensions)

    @cached_property
    def at_rest(self) -> Lengths:
        """The lengths without tensions."""
        return self(np.zeros(self._shape[1]))


@lru_cache(maxsize=48)
def tendon_lengths(
    arm: Arm, scene: Scene, machine_code: bool = False, points: int = _POINTS
) -> TendonLengths:
    """Return the lengths of tendons by tensions; see TendonLengths."""
    return TendonLengths(arm, scene, machine_code, points)


@lru_cache(maxsize=24)
def _by_pull(statics: ClosedStatics) -> ca.Function:
    """Return (tau, xi, k, q), pull, data -> the strains v (n,), and how they move with pull."""
    strain, law = ca.SX.sym("strain", 4), statics.law
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    stretch, v = 1 + strain[3], ca.SX.sym("v", size(law))
    now = law.strains(stretch * strain[:3], ca.vertcat(stretch, 0, 0))
    wrench = statics.wrench(v, pull, data)
    moved = -ca.inv_minor(ca.jacobian(wrench, v)) @ ca.jacobian(wrench, pull)
    found = ca.substitute([ca.vec(ca.densify(moved))], [v], [now])[0]
    given = [strain, pull, data]
    return ca.Function("by_pull", given, [ca.densify(now), found], {"cse": True})


@lru_cache(maxsize=24)
def _runs(law: CrossSection, n_tendons: int) -> ca.Function:
    """Return strains, paths, weights -> weighted |u_c'| of the tendons, and how they move with v.

    Paths (4 n_tendons,) stand one after the other, derivatives (n_tendons, n) column by column.
    """
    v, path = ca.SX.sym("v", size(law)), ca.SX.sym("path", 4)
    one = ca.Function("run", [v, path], [ca.norm_2(law.run(v, path))])
    paths, weight = ca.SX.sym("paths", 4, n_tendons), ca.SX.sym("weight", n_tendons)
    runs = [weight[j] * one(v, paths[:, j]) for j in range(n_tendons)]
    rows = [ca.densify(ca.gradient(run, v)).T for run in runs]
    found = [ca.vertcat(*runs), ca.vec(ca.vertcat(*rows))]
    return ca.Function("runs", [v, ca.vec(paths), weight], found, {"cse": True})
