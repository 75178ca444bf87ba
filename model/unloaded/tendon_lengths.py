"""The lengths of the tendons of an arm without loads, as a function of the tensions.

Data flow: tensions -> strains of the cross-sections (closed form) -> lengths of the tendons by
quadrature, and their derivatives: of the lengths by the strains, of these by the tensions through
the implicit function theorem on the balance of each cross-section. Near strains that are known a
Newton step of each cross-section takes the place of the closed form.
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
# A step of strains, relative to these, beyond which they are solved for anew.
_FAR = 1e-2


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
    strains : (N n_law,)
        Those of the law of the cross-section, at N points.
    strains_moved : (N n_law, n_tendons)
        How they change with the tensions.
    """

    tensions: Array
    lengths: Array
    length_tension: Array
    strains: Array
    strains_moved: Array


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
        functions = strain_function(statics), _strain_step(statics), _runs(statics, arm.n_tendons)
        solve, step, runs = kernels(functions, machine_code)
        given = [part.reshape(self.s.size, -1).T for part in (maps, paths, weight)]
        N, run = self.s.size, runs.map(self.s.size)

        def along(v: ca.MX) -> list[ca.MX]:
            lengths, by_strains, moved = run(v, pull, data, *given)
            return [ca.sum2(lengths), by_strains, v, moved]

        found = along(_of_law(statics.law).map(N)(solve.map(N)(pull, data)))
        self._call = Buffered(ca.Function("tendon_lengths", [T], found))
        near = ca.MX.sym("v", found[2].shape)
        v, off = step.map(N)(near, pull, data)
        beside = ca.Function("tendon_lengths", [near, T], [*along(v), ca.mmax(off)])
        self._beside = Buffered(beside)
        self._n_tendons = arm.n_tendons
        self._robust: Callable[[], TendonLengths] | None = None
        if scene.robust() != scene:
            self._robust = partial(tendon_lengths, arm, scene.robust(), machine_code)

    def __call__(self, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,); raises UnsettledSectionError."""
        found = self._call(tensions)
        if np.isnan(found[0].sum()):
            if self._robust is not None:
                return self._robust()(tensions)
            lost = np.isnan(found[2]).any(axis=1)
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        return _lengths(tensions, found)

    def near(self, at: Lengths, tensions: Array) -> Lengths:
        """Return the lengths under tensions near others; raises UnsettledSectionError."""
        moved = at.strains_moved @ (tensions - at.tensions)
        *found, off = self._beside(at.strains + moved, tensions)
        return _lengths(tensions, found) if float(off[0, 0]) <= _FAR else self(tensions)

    @cached_property
    def at_rest(self) -> Lengths:
        """The lengths without tensions."""
        return self(np.zeros(self._n_tendons))


@lru_cache(maxsize=48)
def tendon_lengths(arm: Arm, scene: Scene, machine_code: bool = False) -> TendonLengths:
    """Return the lengths of tendons by tensions; see TendonLengths."""
    return TendonLengths(arm, scene, machine_code)


def _lengths(tensions: Array, found: list[Array]) -> Lengths:
    lengths, by_strains, v, moved = found
    return Lengths(tensions, lengths[0], by_strains.T @ moved, v.ravel(), moved)


@lru_cache(maxsize=24)
def _of_law(law: CrossSection) -> ca.Function:
    """Return (tau, xi, k, q) -> strains v of the law."""
    strain = ca.SX.sym("strain", 4)
    stretch = 1 + strain[3]
    v = law.strains(stretch * strain[:3], ca.vertcat(stretch, 0, 0))
    return ca.Function("of_law", [strain], [ca.densify(v)])


@lru_cache(maxsize=24)
def _strain_step(statics: ClosedStatics) -> ca.Function:
    """Return v, pull, data -> strains v after a step of Newton's method, and its size.

    The size counts curvatures by the radius, relative to these, as EnergyStatics does.
    """
    v = ca.SX.sym("v", size(statics.law))
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    wrench = statics.wrench(v, pull, data)
    step = -ca.inv_minor(ca.jacobian(wrench, v)) @ wrench
    radius = 2 * ca.sqrt(data[1] / data[0])
    far = radius * ca.norm_inf(step[:2]) / (1 + radius * ca.norm_inf(v[:2]))
    far = ca.norm_inf(ca.vertcat(far, step[2:]))
    return ca.Function("strain_step", [v, pull, data], [v + step, far], {"cse": True})


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
