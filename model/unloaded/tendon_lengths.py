"""The lengths of the tendons of an arm without loads, as a function of the tensions.

Data flow: tensions -> strains of the cross-sections -> lengths of the tendons by quadrature, and
their derivatives: of the lengths by the strains, of these by the tensions through the implicit
function theorem on the balance of each cross-section.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section.law import size
from model.errors import UnsettledSectionError
from model.machine.buffered import Buffered
from model.machine.compiled import kernels
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.stations import crossing, stations, tendon_paths
from model.transcription.collocation import gauss
from model.unloaded.closed_form import pull_at
from model.unloaded.section_solver import SectionSolver, unloaded
from model.unloaded.statics import ClosedStatics, closed_statics

# Strains are analytic between nodes: so many Gauss points on the coarsest mesh leave rounding only,
# whatever mesh poses have. Measured on the paper's arms and random ones at thrice their tensions.
_POINTS = 8


class Lengths(NamedTuple):
    """Tendons under tensions.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    lengths : (n_tendons,)
        [m].
    length_tension : (n_tendons, n_tendons)
        How the lengths change with the tensions [m/N].
    """

    tensions: Array
    lengths: Array
    length_tension: Array


class TendonLengths:
    """Tensions to lengths of the tendons, by Gauss quadrature in each step."""

    def __init__(self, arm: Arm, scene: Scene, machine_code: bool = False) -> None:
        mesh, method, points = graded(arm, 1), gauss(_POINTS), _POINTS
        scene, h = unloaded(scene), np.diff(mesh.s)
        statics = closed_statics(scene, arm)
        self.s = (mesh.s[:-1, None] + h[:, None] * method.c).ravel()
        active, weights = np.repeat(mesh.active, points), np.outer(h, method.b).ravel()
        at = stations(arm, self.s, active)
        place, tendon = np.nonzero(crossing(arm, at))
        shape = self.s.size, arm.n_tendons
        paths, weight = np.zeros((*shape, 4)), np.zeros(shape)
        paths[place, tendon] = tendon_paths(arm, at, place, tendon).T
        weight[place, tendon] = weights[place]

        T, maps = ca.MX.sym("T", arm.n_tendons), statics.pulls(arm, at)
        pull, data = pull_at(arm, statics, self.s, active, T)
        (runs,) = kernels([_runs(statics, arm.n_tendons)], machine_code)
        given = [part.reshape(self.s.size, -1).T for part in (maps, paths, weight)]
        v = ca.MX.sym("v", size(statics.law), self.s.size)
        lengths, by_strains, moved = runs.map(self.s.size)(v, pull, data, *given)
        found = [ca.sum2(lengths), by_strains, moved]
        self._call = Buffered(ca.Function("tendon_lengths", [v, T], found))
        self._sections = SectionSolver(arm, scene, self.s, active, machine_code)
        self._n_tendons = arm.n_tendons

    def __call__(self, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,); raises UnsettledSectionError."""
        v = self._sections.strains(tensions)
        lost = np.isnan(v).any(axis=1)
        if lost.any():
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        lengths, by_strains, moved = self._call(v.ravel(), tensions)
        return Lengths(tensions, lengths[0], by_strains.T @ moved)

    @cached_property
    def at_rest(self) -> Lengths:
        """The lengths without tensions."""
        return self(np.zeros(self._n_tendons))


@lru_cache(maxsize=48)
def tendon_lengths(arm: Arm, scene: Scene, machine_code: bool = False) -> TendonLengths:
    """Return the lengths of tendons by tensions; see TendonLengths."""
    return TendonLengths(arm, scene, machine_code)


@lru_cache(maxsize=24)
def _runs(statics: ClosedStatics, n_tendons: int) -> ca.Function:
    """Return v, pull, data, maps, paths, weights -> |u_c'| of tendons, and their derivatives.

    v are the strains of the law, maps (n_pull n_tendons,) take tensions to pull, row by row, paths
    (4 n_tendons,) stand one after the other. |u_c'| (n_tendons,) and its derivatives by v count by
    the weights; derivatives of v by the tensions are (n_tendons, n).
    """
    law, v = statics.law, ca.SX.sym("v", size(statics.law))
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    maps = ca.SX.sym("maps", n_tendons, statics.n_pull)
    paths, weight = ca.SX.sym("paths", 4, n_tendons), ca.SX.sym("weight", n_tendons)
    wrench = statics.wrench(v, pull, data)
    moved = -ca.inv_minor(ca.jacobian(wrench, v)) @ ca.jacobian(wrench, pull)
    moved = moved @ (ca.diag(ca.diag(maps)) if statics.each_alone else maps.T)
    runs = [weight[j] * ca.norm_2(law.run(v, paths[:, j])) for j in range(n_tendons)]
    jacobian = ca.vertcat(*(ca.densify(ca.gradient(run, v)).T for run in runs))
    found = [ca.vertcat(*runs), ca.densify(jacobian), ca.densify(moved.T)]
    given = [v, pull, data, ca.vec(maps), ca.vec(paths), weight]
    return ca.Function("runs", given, found, {"cse": True})
