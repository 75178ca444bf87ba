"""Forward maps, from tensions to equilibria, and the mesh on which an error is small enough.

The forward map of a scene is explicit if each cross-section is in equilibrium by itself, and solves
the coupled equations by collocation otherwise. The difference of two meshes, with the order of
convergence, estimates the error of the finer one.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.explicit import ClosedForm, ExplicitMap
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.loads import check_loads, convergence_order, is_coupled
from octoplan.model.rod.collocation import MAGNUS6
from octoplan.model.rod.discrete_rod import system
from octoplan.model.scene import Scene
from octoplan.model.support.checks import within
from octoplan.model.support.errors import ConvergenceError
from octoplan.model.support.progress import check_time

T = TypeVar("T")
ForwardMap = CollocationMap | ExplicitMap

# The order of convergence of all forward maps for smooth solutions: three Gauss points per element.
ORDER = 2 * STAGES
# The largest tip error over arm length that may be requested.
LOOSEST = 0.1
# The smallest tip error over arm length that may be requested.
FINEST_ACCURACY = 1e-12
# Refinements of meshes. Each is at most twice the second last, so that a mesh is seldom finer than
# necessary.
REFINEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
# The largest refinement.
FINEST = REFINEMENTS[-1]
# The largest refinement of the first two meshes of a settle.
_FINEST_FIRST = 64
# Relative error of a result by rounding.
ROUNDING = 1e-14
# Safety factor of error estimates.
CAUTION = 4.0
# The remedy if the finest mesh is not accurate enough.
REMEDY = "ask for less accuracy or a smoother arm"


def forward_map(
    arm: Arm,
    scene: Scene,
    refinement: int,
    at: tuple[float, ...] = (),
    machine_code: bool = False,
) -> ForwardMap:
    """Return the forward map of an arm in a scene on the mesh of a refinement.

    Parameters
    ----------
    at : tuple of float
        Arc lengths of further nodes of the mesh [m].
    machine_code : bool
        Whether the kernels are compiled. CasADi cannot differentiate compiled kernels.
    """
    for effect in scene.effects:
        own = effect.forward_map(arm, scene, refinement, at, machine_code)
        if own is not None:
            return own
    if is_coupled(arm, scene):
        return CollocationMap(system(arm, scene, STAGES, refinement, at, True, machine_code))
    return ClosedForm(arm, scene, MAGNUS6, refinement, at, machine_code)


def collocation_map(
    arm: Arm,
    scene: Scene,
    refinement: int,
    at: tuple[float, ...] = (),
    machine_code: bool = False,
    moments: bool = False,
) -> CollocationMap:
    """Return the forward map by collocation, in scenes without loads too.

    With `moments` the equations have torsion and the moment at the nodes, which they have under
    loads in any case. See `forward_map` for the other parameters.
    """
    if is_coupled(arm, scene):
        result = forward_map(arm, scene, refinement, at, machine_code)
        assert isinstance(result, CollocationMap)
        return result
    return CollocationMap(system(arm, scene, STAGES, refinement, at, moments, machine_code))


def explicit_map(arm: Arm, scene: Scene, refinement: int) -> ExplicitMap:
    """Return the map from tensions to poses in interpreted code, if has_explicit_map."""
    if is_coupled(arm, scene):
        return ClosedForm(arm, scene, MAGNUS6, refinement)
    result = forward_map(arm, scene, refinement)
    assert isinstance(result, ExplicitMap)
    return result


class ForwardMaps:
    """The forward maps of an arm in a scene, one for each mesh.

    Raises InputError for loads that the arm cannot have.

    Attributes
    ----------
    order : int
        The order of convergence in this scene.
    lever : float
        Lever arm of the rotation of the tip in the error [m], 0 without loads: loads can twist a
        straight arm without a displacement of its tip.
    """

    def __init__(self, arm: Arm, scene: Scene, machine_code: bool) -> None:
        check_loads(arm, scene, contact=True)
        self.arm = arm
        self.scene = scene
        self.machine_code = machine_code
        self.order = convergence_order(scene, ORDER)
        self.lever = arm.base_radius * is_coupled(arm, scene)
        self._maps: dict[int, ForwardMap] = {}

    def on(self, refinement: int, at: tuple[float, ...] = ()) -> ForwardMap:
        """Return the forward map on the mesh of a refinement; see forward_map.

        Maps without further nodes `at` are cached.
        """
        if at:
            return forward_map(self.arm, self.scene, refinement, at, self.machine_code)
        if refinement not in self._maps:
            self._maps[refinement] = forward_map(
                self.arm, self.scene, refinement, machine_code=self.machine_code
            )
        return self._maps[refinement]


@lru_cache(maxsize=64)
def forward_maps(arm: Arm, scene: Scene, machine_code: bool) -> ForwardMaps:
    """Return the forward maps of an arm in a scene, cached."""
    return ForwardMaps(arm, scene, machine_code)


def checked_accuracy(accuracy: Any) -> float:
    """Return the accuracy as a float; raise InputError outside of [1e-12, 0.1]."""
    return within("accuracy", accuracy, FINEST_ACCURACY, LOOSEST)


@lru_cache(maxsize=16)
def first_pair(accuracy: float) -> tuple[int, int]:
    """Return the first two refinements for an accuracy; the second is about twice the first.

    The coarsest mesh has an error of about 10^(1 - order) of the length if the arm is bent but not
    rolled up.
    """
    error = CAUTION * 10.0 ** (1 - ORDER)
    return pair_for((error / accuracy) ** (1 / ORDER), _FINEST_FIRST)


def pair_for(wanted: float, finest: float) -> tuple[int, int]:
    """Return two refinements, the second from 2 and `wanted` on and at most `finest`."""
    fine = REFINEMENTS[bisect_left(REFINEMENTS, min(max(wanted, 2), finest))]
    coarse = REFINEMENTS[bisect_right(REFINEMENTS, fine / 2) - 1]
    return coarse, fine


def estimate(gap: Any, coarse: Any, fine: int, order: int, rounding: float = ROUNDING) -> Any:
    """Return the error of the finer of two meshes whose results differ by a gap."""
    return CAUTION * gap / ((fine / coarse) ** order - 1) + rounding


def initial_estimate(order: int) -> float:
    """Return the estimate before the first pair of meshes; see updated_estimate.

    The estimate is infinite for order one, because a single gap is no evidence of the error of a
    solution with jumps.
    """
    return np.inf if order == 1 else 0.0


def updated_estimate(
    before: Any, gap: Any, coarse: Any, fine: int, order: int, rounding: float = ROUNDING
) -> tuple[Any, Any]:
    """Return the error of the finer of two meshes, and the estimate by their gap alone.

    The error is the larger of this estimate and of that `before`, of the coarser mesh, reduced by
    the order. If solutions have kinks, a gap may be small by chance.
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
    """Return a result on the first mesh that is accurate enough, its refinement and its error.

    Parameters
    ----------
    pair : (int, int)
        The first two refinements.
    on : callable
        Refinement -> result.
    gap : callable
        Two results -> their relative difference.

    Raises
    ------
    ConvergenceError
        If the finest mesh is not accurate enough.
    """
    coarse, refinement = pair
    error = np.inf
    before = on(coarse)
    known = initial_estimate(order)
    while refinement:
        check_time()
        result = on(refinement)
        difference = gap(result, before)
        error, known = updated_estimate(known, difference, coarse, refinement, order)
        if error <= accuracy:
            return result, refinement, float(error)
        before = result
        coarse = refinement
        refinement = next_refinement(refinement, error, accuracy, order)
    raise ConvergenceError(accuracy, error, REMEDY)


def next_refinement(refinement: int, error: float, accuracy: float, order: int) -> int:
    """Return the refinement for an accuracy after one with an error, 0 beyond the finest.

    Estimates of large errors are unreliable: the refinement grows by a factor of four at most, and
    by two without an estimate.
    """
    if refinement >= FINEST:
        return 0
    factor = (error / accuracy) ** (1 / order) if math.isfinite(error) else 2.0
    wanted = bisect_left(REFINEMENTS, refinement * factor)
    least = bisect_right(REFINEMENTS, refinement)
    most = bisect_right(REFINEMENTS, 4 * refinement) - 1
    return REFINEMENTS[min(max(wanted, least), most)]
