"""The forward maps, tensions to poses: which scheme carries a scene, and which mesh is fine enough.

Maps are built once for each mesh. The tip on one mesh and on the next finer one tell the error of
the latter, by the order of the scheme.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import lru_cache
from itertools import zip_longest
from typing import Any, TypeVar

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.printed import PrintedMap, PrintedStatics
from octoplan.model.integrators import MAGNUS2, MAGNUS4, MAGNUS6, RK4, RK6, RK8
from octoplan.model.loads import check_loads, convergence_order, is_loaded
from octoplan.model.rod.system import system
from octoplan.model.scene import Scene
from octoplan.model.support.checks import within
from octoplan.model.support.errors import ConvergenceError, InputError
from octoplan.model.support.progress import check_time
from octoplan.model.unloaded.closed_form import ClosedForm
from octoplan.model.unloaded.marched import ExplicitMap

T = TypeVar("T")
LOOSEST, FINEST_ACCURACY = 0.1, 1e-12
# Whole numbers, each at most twice the one two places before: a mesh is seldom finer than needed.
REFINEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
FINEST = REFINEMENTS[-1]
CAUTION = 4.0
# What to do where the finest mesh is not accurate enough.
COARSE = "ask for less accuracy or a smoother arm"
# What rounding leaves, over L: of explicit maps, and of equilibria found by Newton's method.
ROUNDING, IMPLICIT = 1e-14, 5e-13
# By name: closed forms, stages of collocation, and integrators of the equations as printed. Of each
# the first is used unless another is named.
CLOSED_FORMS = {scheme.name: scheme for scheme in (MAGNUS6, MAGNUS4, MAGNUS2)}
COLLOCATIONS = {"gauss6": 3, "gauss4": 2, "gauss2": 1, "gauss8": 4}
PRINTED = {scheme.name: scheme for scheme in (RK6, RK8, RK4)}
SCHEMES = (*CLOSED_FORMS, *COLLOCATIONS, *PRINTED)

ForwardMap = Collocation | ExplicitMap


def schemes_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the schemes that can carry a scene.

    First the one that is used unless another is named, then the one that checks it.
    """
    if scene.has(PrintedStatics):
        return tuple(PRINTED)
    if is_loaded(scene):
        return tuple(COLLOCATIONS)
    pairs = zip_longest(CLOSED_FORMS, COLLOCATIONS)
    return tuple(name for pair in pairs for name in pair if name)


def check_scheme(scene: Scene, scheme: str | None) -> str:
    """Return the scheme by name, the scene's first for None; InputError if it cannot carry it."""
    allowed = schemes_of(scene)
    if scheme is not None and not (isinstance(scheme, str) and scheme in allowed):
        raise InputError("scheme", scheme, ", ".join(allowed) + " in this scene")
    return scheme or allowed[0]


def by_collocation(
    arm: Arm,
    scene: Scene,
    stages: int,
    refinement: int,
    at: tuple[float, ...] = (),
    loaded: bool | None = None,
    machine_code: bool = False,
) -> Collocation:
    """Return the forward map by collocation with so many stages.

    With torsion, moment and force where it is `loaded`, as the scene is unless told.
    """
    if contacts(scene):
        return TouchingMap(arm, scene, stages, refinement, at, machine_code)
    loaded = is_loaded(scene) if loaded is None else loaded
    return Collocation(system(arm, scene, stages, refinement, at, loaded, machine_code))


def explicit_map(
    arm: Arm,
    scene: Scene,
    scheme: str,
    refinement: int,
    at: tuple[float, ...] = (),
    machine_code: bool = False,
) -> ClosedForm | PrintedMap:
    """Return the forward map in closed form or as printed on a mesh; see Maps.on.

    CasADi cannot differentiate its `function` where its kernels are compiled.
    """
    if scheme in PRINTED:
        return PrintedMap(arm, scene, PRINTED[scheme], refinement, at, machine_code)
    return ClosedForm(arm, scene, CLOSED_FORMS[scheme], refinement, at, machine_code)


class Maps:
    """The forward maps of an arm in a scene by a scheme, mesh by mesh.

    Raises InputError for loads that the arm cannot have.

    Attributes
    ----------
    order, least_order : int
        Of the scheme where all is smooth, and that error estimates in this scene count on.
    rounding : float
        What it leaves of the tip's error over the arm's length.
    lever : float
        How far off the tip the error is looked at as well [m]: loads can twist a straight arm.
    """

    def __init__(self, arm: Arm, scene: Scene, scheme: str, machine_code: bool) -> None:
        check_loads(arm, scene, contact=True)
        self.arm, self.scene, self.scheme, self.machine_code = arm, scene, scheme, machine_code
        explicit, self.stages = (CLOSED_FORMS | PRINTED).get(scheme), COLLOCATIONS.get(scheme, 0)
        self.order, self.rounding = 2 * self.stages, IMPLICIT
        if explicit:
            self.order, self.rounding = explicit.order, ROUNDING
        self.contacts, self.least_order = contacts(scene), convergence_order(scene, self.order)
        self.lever = arm.base_radius * is_loaded(scene)
        self._kept: dict[int, ForwardMap] = {}

    def on(self, refinement: int, at: tuple[float, ...] = ()) -> ForwardMap:
        """Return the forward map on the mesh of a refinement, which is kept.

        Not with arc lengths `at` as further nodes: there may be many.
        """
        if refinement in self._kept and not at:
            return self._kept[refinement]
        of, mesh, code = (self.arm, self.scene), (refinement, at), self.machine_code
        result: ForwardMap
        if self.stages:
            result = by_collocation(*of, self.stages, *mesh, machine_code=code)
        else:
            result = explicit_map(*of, self.scheme, *mesh, code)
        if not at:
            self._kept[refinement] = result
        return result


@lru_cache(maxsize=64)
def maps_of(arm: Arm, scene: Scene, scheme: str | None, machine_code: bool) -> Maps:
    """Return the forward maps by a scheme, the scene's first for None."""
    return Maps(arm, scene, check_scheme(scene, scheme), machine_code)


def checked_accuracy(accuracy: Any) -> float:
    """Return the accuracy as a float; InputError outside of [1e-12, 0.1]."""
    return within("accuracy", accuracy, FINEST_ACCURACY, LOOSEST)


def first_pair(accuracy: float, order: int) -> tuple[int, int]:
    """Return the two refinements to begin with, one about twice the other.

    A first mesh is good to about 10^(1 - order) of the length, for arms that are bent but not
    rolled up.
    """
    return pair_for((CAUTION * 10.0 ** (1 - order) / accuracy) ** (1 / order), 64)


def pair_for(wanted: float, finest: float) -> tuple[int, int]:
    """Return refinements of which the second is as fine as wanted, up to the finest, from 2 on."""
    fine = REFINEMENTS[bisect_left(REFINEMENTS, min(max(wanted, 2), finest))]
    return REFINEMENTS[bisect_right(REFINEMENTS, fine / 2) - 1], fine


def estimate(gap: Any, coarse: Any, fine: int, order: int, rounding: float = ROUNDING) -> Any:
    """Return the tip error over L of the finer of two meshes whose tips are a gap apart, over L."""
    return CAUTION * gap / ((fine / coarse) ** order - 1) + rounding


def no_estimate(order: int) -> float:
    """Return what stands for the estimate of a mesh before the first; see larger_estimate.

    Infinite for order one, of solutions that jump: a single gap says too little of them.
    """
    return np.inf if order == 1 else 0.0


def larger_estimate(
    before: Any, gap: Any, coarse: Any, fine: int, order: int, rounding: float = ROUNDING
) -> tuple[Any, Any]:
    """Return the estimated error of the finer of two meshes, over L, and the estimate by their gap.

    The error is the larger of that and of the estimate before, of the coarser mesh, as far as the
    order lowers it: where solutions have kinks a gap may be small by chance, by where nodes are.
    """
    now = estimate(gap, coarse, fine, order, rounding=0.0)
    return np.maximum(now, before * (coarse / fine) ** order) + rounding, now


def refined(
    pair: tuple[int, int],
    accuracy: float,
    order: int,
    on: Callable[[int], T],
    gap: Callable[[T, T], float],
) -> tuple[T, int, float]:
    """Return what `on` has by refinement, on the first mesh accurate enough.

    And its refinement, and the estimated error, by its relative `gap` from that on the mesh before.
    `pair` are the first two refinements. Raises ConvergenceError.
    """
    (coarse, refinement), error = pair, np.inf
    before, known = on(coarse), no_estimate(order)
    while refinement:
        check_time()
        result = on(refinement)
        error, known = larger_estimate(known, gap(result, before), coarse, refinement, order)
        if error <= accuracy:
            return result, refinement, float(error)
        before, coarse = result, refinement
        refinement = next_refinement(refinement, error, accuracy, order)
    raise ConvergenceError(accuracy, error, COARSE)


def next_refinement(refinement: int, error: float, accuracy: float, order: int) -> int:
    """Return the refinement that should do after one that left an error, 0 past the finest.

    Where an error is far off its estimate says little: no more than four times as fine at once,
    twice where there is no estimate.
    """
    if refinement >= FINEST:
        return 0
    more = (error / accuracy) ** (1 / order) if math.isfinite(error) else 2.0
    wanted = bisect_left(REFINEMENTS, refinement * more)
    least = bisect_right(REFINEMENTS, refinement)
    most = bisect_right(REFINEMENTS, 4 * refinement) - 1
    return REFINEMENTS[min(max(wanted, least), most)]
