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
from model.cross_section.law import size
from model.errors import UnsettledSectionError
from model.machine.buffered import Buffered
from model.machine.compiled import kernels
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.stations import crossing, stations, tendon_paths
from model.transcription.collocation import gauss
from model.unloaded.closed_form import pull_at, strain_function, unloaded
from model.unloaded.length_steps import newton_steps
from model.unloaded.statics import ClosedStatics, closed_statics

# Strains are analytic between nodes: so many Gauss points on the coarsest mesh leave rounding only,
# whatever mesh poses have. Measured on the paper's arms and random ones at thrice their tensions.
_POINTS = 8
# So few leave 1e-7 of the arm's length at most, of tensions mostly less than 1e-5: to begin with.
FEW = 3
# Newton steps in one call.
_STEPS = 2


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


class Stepped(NamedTuple):
    """Where Newton steps lead to.

    Attributes
    ----------
    at : Lengths
        Before the last of them.
    to : (n_tendons,)
        Tensions after it [N].
    solved : bool
        Whether these are those of the linearised lengths.
    """

    at: Lengths
    to: Array
    solved: bool


class TendonLengths:
    """Tensions to lengths of the tendons, by Gauss quadrature with `points` in each step."""

    def __init__(
        self, arm: Arm, scene: Scene, machine_code: bool = False, points: int = _POINTS
    ) -> None:
        mesh, method = graded(arm, 1), gauss(points)
        scene, h = unloaded(scene), np.diff(mesh.s)
        statics = closed_statics(scene, arm)
        if points <= FEW:
            statics = statics.rough()
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
        functions = strain_function(statics), _length_jacobian(statics, arm.n_tendons)
        strain, jacobian = kernels(functions, machine_code)
        strains = strain.map(self.s.size)(pull, data)
        given = (part.reshape(self.s.size, -1).T for part in (maps, paths, weight))
        lengths, by_strains, moved = jacobian.map(self.s.size)(strains, pull, data, *given)
        by_tensions = by_strains @ moved.T
        total = ca.sum2(lengths)
        if points <= FEW:  # no guess is crushed: the paper's balance goes on beyond
            total = ca.if_else(ca.mmin(strains[3, :]) > -1, total, np.nan)
        found = [total, ca.densify(by_tensions)]
        self.function = ca.Function("tendon_lengths", [T], found)
        self._call, self._machine_code = Buffered(self.function), machine_code
        self._strains = ca.Function("strains", [T], [strains])
        self._robust: Callable[[], TendonLengths] | None = None
        if scene.robust() != scene:
            self._robust = partial(tendon_lengths, arm, scene.robust(), machine_code, points)

    def __call__(self, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,); raises UnsettledSectionError."""
        lengths, by_tensions = self._call(tensions)
        if np.isnan(lengths.sum()):
            if self._robust is not None:
                return self._robust()(tensions)
            lost = np.isnan(self._strains(tensions).full()).any(axis=0)
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        return Lengths(tensions, lengths[0], by_tensions.T.copy())

    def stepped(self, at: Lengths, left: Array, soft: Array, held: Array) -> Stepped:
        """Return where Newton steps lead to tensions that winches ask for; see newton_steps."""
        T, lengths, jacobian, to, wrong = self._steps(
            *at[:2], at.by_tensions.T.ravel(), left, soft, held
        )
        return Stepped(Lengths(T[0], lengths[0], jacobian.T.copy()), to[0], wrong[0, 0] == 0)

    @cached_property
    def _steps(self) -> Buffered:
        return Buffered(newton_steps(self.function, _STEPS, self._machine_code))

    @cached_property
    def at_rest(self) -> Lengths:
        """The lengths without tensions."""
        return self(np.zeros(self.function.numel_in(0)))


@lru_cache(maxsize=48)
def tendon_lengths(
    arm: Arm, scene: Scene, machine_code: bool = False, points: int = _POINTS
) -> TendonLengths:
    """Return the lengths of tendons by tensions; see TendonLengths."""
    return TendonLengths(arm, scene, machine_code, points)


@lru_cache(maxsize=24)
def _length_jacobian(statics: ClosedStatics, n_tendons: int) -> ca.Function:
    """Return strains, pull, data, maps, paths, weights -> |u_c'| of tendons, and their derivatives.

    Strains are (tau, xi, k, q), maps (n_pull n_tendons,) take tensions to pull, row by row, paths
    (4 n_tendons,) stand one after the other. |u_c'| (n_tendons,) and its derivatives by the strains
    v (n_tendons, n) count by the weights; derivatives of v by the tensions are (n_tendons, n).
    """
    strain, law = ca.SX.sym("strain", 4), statics.law
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    maps = ca.SX.sym("maps", n_tendons, statics.n_pull)
    paths, weight = ca.SX.sym("paths", 4, n_tendons), ca.SX.sym("weight", n_tendons)
    stretch, v = 1 + strain[3], ca.SX.sym("v", size(law))
    now = law.strains(stretch * strain[:3], ca.vertcat(stretch, 0, 0))
    wrench = statics.wrench(v, pull, data)
    moved = -ca.inv_minor(ca.jacobian(wrench, v)) @ ca.jacobian(wrench, pull)
    moved = moved @ (ca.diag(ca.diag(maps)) if statics.each_alone else maps.T)
    runs = [weight[j] * ca.norm_2(law.run(v, paths[:, j])) for j in range(n_tendons)]
    jacobian = ca.vertcat(*(ca.densify(ca.gradient(run, v)).T for run in runs))
    found = [ca.vertcat(*runs), ca.densify(jacobian), ca.densify(moved.T)]
    found = ca.substitute(found, [v], [now])
    given = [strain, pull, data, ca.vec(maps), ca.vec(paths), weight]
    return ca.Function("jacobian", given, found, {"cse": True})
