"""A sufficient condition for an arm to have one equilibrium under its loads, at any tensions.

The energy of the cross-sections, with the tendons at constant tension, is convex in the strains.
The arm has one equilibrium if the loads do not spoil this convexity. Vary the curvature by k(s).
The frames rotate by theta(s), |theta| <= Theta(s) = integral of |k| from the base. A dead force
F(s) beyond s does work on the second variation of u' = R t:

    F . (theta x (theta x t)) + F . (w x t),    w = integral of theta x theta' from the base.

With psi the angle between -F and t the first term is at most |F| Theta^2 (1 + cos psi) / 2. A curve
of length Theta from the origin encloses at most Theta^2 / (2 pi) with its chord (isoperimetric
inequality), so |w| <= Theta^2 / pi, and the second term is at most |F| Theta^2 sin(psi) / pi. The
largest sum over psi is SPATIAL |F| Theta^2. Extension adds 2 |F| Theta |dq|, which E A dq^2 bounds.
The energy is therefore convex at every shape if

    integral of min(EJ, GI) Theta'^2 > integral of c |F| Theta^2  for all Theta with Theta(0) = 0,

that is, if an upright column with these forces does not buckle. Loads without a potential are
covered by the same inequality for the symmetric part of their derivative (a strictly monotone
operator has one zero).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import STIFFNESS_SIZE
from octoplan.model.cross_section.of_scene import body_numbers
from octoplan.model.loads import force_bound, turning_bounds
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.stations import stations

# Largest value of (1 + cos psi) / 2 + sin(psi) / pi.
SPATIAL = 0.5 + np.hypot(0.5, 1 / np.pi)
# Intervals of the column: the critical load has a relative error of about 1 / _INTERVALS^2.
_INTERVALS = 128


@lru_cache(maxsize=128)
def has_unique_equilibrium(arm: Arm, scene: Scene) -> bool:
    """Return whether the loads are too weak for a second equilibrium, at any tensions.

    The condition is sufficient, not necessary. It is derived for bodies of linear material, and
    applied to neo-Hookean bodies with their stiffness at rest.
    """
    s = np.linspace(0.0, arm.length, _INTERVALS + 1)
    middle = (s[1:] + s[:-1]) / 2
    at = stations(arm, middle, np.zeros(middle.size, np.int64))
    EA, EJn, EJb, GI, GA = body_numbers(arm, scene, at)[:STIFFNESS_SIZE]
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
