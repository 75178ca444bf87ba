"""The loads of a scene: sums over rod terms, loads of another scene, and a bound for buckling."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import STIFFNESS_SIZE, body_parameters, cross_section_of
from octoplan.model.effects.base import Effect
from octoplan.model.mesh import stations
from octoplan.model.paths import Array
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.scene import Scene
from octoplan.model.support.checks import LARGEST

# Largest value of (1 + cos psi) / 2 + sin(psi) / pi.
SPATIAL = 0.5 + np.hypot(0.5, 1 / np.pi)
# Intervals of the column: the critical load has a relative error of about 1 / _INTERVALS^2.
_INTERVALS = 128


@lru_cache(maxsize=128)
def rod_terms(arm: Arm, scene: Scene) -> tuple[RodTerm, ...]:
    """Return the contributions of the effects of a scene, and of the tendons, to the rod.

    Tendons with guides pull at the guides. Tendons that turn around the midline twist the arm: the
    cross-sections have torsion.
    """
    terms = scene.rod_terms
    if arm.is_guided:
        from octoplan.model.extensions.guides import GuideTerm

        terms = (*terms, GuideTerm.of(arm, scene))
    if any(arm.angle_paths) and not any(term.couples_sections for term in terms):
        from octoplan.model.rod.load_terms import CouplingTerm

        terms = (*terms, CouplingTerm())
    return terms


def is_coupled(arm: Arm, scene: Scene) -> bool:
    """Return whether effects of a scene or tendons couple cross-sections, or twist them.

    For all other arms and scenes each cross-section settles by itself.
    """
    return any(term.couples_sections for term in rod_terms(arm, scene))


def has_explicit_map(arm: Arm, scene: Scene) -> bool:
    """Return whether each cross-section settles by itself, twisted or not.

    Beyond arms and scenes that are not coupled, these are arms whose tendons turn around the
    midline.
    """
    return not arm.is_guided and not any(term.couples_sections for term in scene.rod_terms)


def with_loads_of(scene: Scene, other: Scene) -> Scene | None:
    """Return a scene with the load values of another scene.

    Loads that the other scene lacks are 0 in the result, so that the equations of both scenes have
    one structure. Return None if other effects differ, or if the other scene has further loads.
    """
    known = {(type(each), each.place): each for each in other.effects}
    effects = list[Effect]()
    for effect in scene.effects:
        before = known.pop((type(effect), effect.place), None)
        if before is None:
            before = effect.without_force()
        elif before.without_force() != effect.without_force():
            return None
        if before is None:
            return None
        effects.append(before)
    return None if known else Scene(*effects)


def has_complementarity(scene: Scene) -> bool:
    """Return whether equilibria depend on a set of active contacts."""
    return any(effect.has_complementarity for effect in scene.effects)


def is_path_dependent(scene: Scene) -> bool:
    """Return whether equilibria depend on the motion that leads to them."""
    return any(effect.is_path_dependent for effect in scene.effects)


def is_conservative(scene: Scene) -> bool:
    """Return whether all loads of a scene have a potential."""
    return all(term.is_conservative for term in scene.rod_terms)


def convergence_order(scene: Scene, order: int, derivatives: bool = False) -> int:
    """Return the order at which errors in a scene fall; `order` is the order of smooth solutions.

    With `derivatives` the order of derivatives of the equilibrium, which jump at kinks.
    """
    is_bent = any(term.bends for term in scene.rod_terms)
    orders = (term.convergence_order(order, derivatives, is_bent) for term in scene.rod_terms)
    return min(orders, default=order)


def check_loads(arm: Arm, scene: Scene, contact: bool = False) -> None:
    """Raise InputError for effects that the calling function does not support; see check_arm.

    Functions that support contact with obstacles pass `contact`.
    """
    for effect in scene.effects:
        effect.check_supported(contact)
    check_arm(arm, scene)


def check_arm(arm: Arm, scene: Scene) -> None:
    """Raise InputError for loads that this arm cannot have, and for loads that the arm lacks."""
    for effect in scene.effects:
        effect.check_arm(arm)


def check_responses(scene: Scene) -> None:
    """Raise InputError if the response of an arm to loads is undefined in a scene."""
    for effect in scene.effects:
        effect.check_responses()


def required_arc_lengths(arm: Arm, scene: Scene) -> tuple[float, ...]:
    """Return the arc lengths inside the arm at which the mesh must have a node [m]."""
    return tuple(s for term in rod_terms(arm, scene) for s in term.required_arc_lengths(arm))


def growth_rate(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return a bound of the rate at which solutions grow or decay at s (N,), per length [1/m].

    The rate is (F / EJ)^(1/2) under a force F.
    """
    force = force_bound(arm, scene, s)
    EA, EJn, EJb, _ = arm.section_stiffness(s)[0]
    stretch = 1 + force / EA * cross_section_of(scene).extension
    return np.asarray(np.minimum(stretch * np.sqrt(force / np.minimum(EJn, EJb)), LARGEST))


def force_bound(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return a bound of the resultant force (N,) of all loads between s (N,) and the tip [N]."""
    force = np.zeros(s.size)
    for term in rod_terms(arm, scene):
        force += term.force_bound(arm, s)
    return force


def turning_bounds(arm: Arm, scene: Scene) -> tuple[Array, Array]:
    """Return bounds of the moments that loads exert per squared rotation of a cross-section.

    Arc lengths (n,) [m] and moments (n,) [N m]; see RodTerm.turning_bounds.
    """
    rows = [row for term in rod_terms(arm, scene) for row in term.turning_bounds(arm)]
    table = np.array(rows).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def dead_resultant(arm: Arm, scene: Scene, s: Array, end: Array) -> Array:
    """Return the resultant (3, N) of all dead forces between s (N,) and the tip [N].

    In the base frame. Point loads count from `end` (N,) on: the far nodes of the elements that s
    lie in.
    """
    force = np.zeros((3, s.size))
    for term in rod_terms(arm, scene):
        force += term.dead_resultant(arm, s, end)
    return force


@lru_cache(maxsize=128)
def has_unique_equilibrium(arm: Arm, scene: Scene) -> bool:
    """Return whether the loads are too weak for a second equilibrium, at any tensions.

    The condition is sufficient, not necessary. It is derived for bodies of linear material, and
    applied to neo-Hookean bodies with their stiffness at rest.

    The energy of the cross-sections, with the tendons at constant tension, is convex in the
    strains. The arm has one equilibrium if the loads do not spoil this convexity. Vary the
    curvature by k(s). The frames rotate by theta(s), |theta| <= Theta(s) = integral of |k| from
    the base. A dead force F(s) beyond s does work on the second variation of u' = R t:

      F . (theta x (theta x t)) + F . (w x t),    w = integral of theta x theta' from the base.

    With psi the angle between -F and t the first term is at most |F| Theta^2 (1 + cos psi) / 2.
    A curve of length Theta from the origin encloses at most Theta^2 / (2 pi) with its chord
    (isoperimetric inequality), so |w| <= Theta^2 / pi, and the second term is at most |F|
    Theta^2 sin(psi) / pi. The largest sum over psi is SPATIAL |F| Theta^2. Extension adds 2 |F|
    Theta |dq|, which E A dq^2 bounds. The energy is therefore convex at every shape if

      integral of min(EJ, GI) Theta'^2 > integral of c |F| Theta^2  for all Theta with Theta(0) = 0,

    that is, if an upright column with these forces does not buckle. Loads without a potential
    are covered by the same inequality for the symmetric part of their derivative (a strictly
    monotone operator has one zero).
    """
    s = np.linspace(0.0, arm.length, _INTERVALS + 1)
    middle = (s[1:] + s[:-1]) / 2
    at = stations(arm, middle, np.zeros(middle.size, np.int64))
    EA, EJn, EJb, GI, GA = body_parameters(arm, scene, at)[:STIFFNESS_SIZE]
    EJ = np.minimum(EJn, EJb)
    axial = np.minimum(EA, GA) if GA.any() else EA
    stiffness = np.minimum(EJ, GI) / np.diff(s)
    force = force_bound(arm, scene, s)
    stretch = force / np.interp(s, middle, axial)
    weight = force * (SPATIAL + (SPATIAL + 1) * stretch)
    places, moments = turning_bounds(arm, scene)
    loads = np.gradient(s) * weight
    loads[[0, -1]] /= 2
    np.add.at(loads, np.rint(places / arm.length * _INTERVALS).astype(int), moments)
    return _is_definite(stiffness, loads)


def _is_definite(stiffness: Array, loads: Array) -> bool:
    """Return whether the column of springs (N,) between nodes bears loads (N + 1,) upright."""
    band = np.zeros((2, stiffness.size))
    band[0, 1:] = -stiffness[1:]
    band[1] = stiffness + np.append(stiffness[1:], 0.0) - loads[1:]
    if not np.isfinite(band).all():
        return False
    try:
        cholesky_banded(band)
    except LinAlgError:
        return False
    return True
