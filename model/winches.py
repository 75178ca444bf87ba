"""What holds the tendons of an arm: winches that leave them a length, or forces.

And Newton steps of tensions that cannot push, to the least ones where they are undetermined.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import LARGEST, SMALLEST, not_negative
from model.errors import InputError
from model.mesh import graded
from model.paths import Array
from model.stations import Counts, Stations, crossing, stations, tendon_paths

# Compliance of held tendons as a share of the arm's own, so that combinations of lengths that no
# strain changes do not matter.
_LEAST_COMPLIANCE = 1e-10
# Of the mesh on which lengths at rest are summed up.
_REST = 16
# A tendon pulls where its tension shortens it, in the straight arm, by more than this share of the
# arm's length; below is rounding of solvers.
_PULLS = 1e-8


@dataclass(frozen=True, eq=False)
class Winches:
    """The lengths that winches leave of tendons, and the tensions of the others.

    A tendon whose path in the arm is l meets l <= length + stretch T and T >= 0, one of the two
    with equality: it is taut, or slack.

    Attributes
    ----------
    held : (n_tendons,)
        Whether a winch holds a length; otherwise a force holds the tension.
    lengths : (n_tendons,)
        What is left, without tension, between base and anchorage [m]; 0 where a tension is held.
    tensions : (n_tendons,)
        [N]; 0 where a length is held.
    tendon_EA : float
        Stiffness of the tendons themselves [N]; infinite where they do not stretch.
    outside : float
        How much more of each tendon there is between its winch and the base [m].
    """

    held: NDArray[np.bool_]
    lengths: Array
    tensions: Array
    tendon_EA: float = np.inf
    outside: float = 0.0

    @property
    def stretch(self) -> Array:
        """By how much each tendon is longer for each newton (n_tendons,) [m/N]."""
        return np.asarray(np.where(self.held, (self.lengths + self.outside) / self.tendon_EA, 0.0))

    @classmethod
    def of(
        cls, arm: Arm, tensions: Any, lengths: Any, tendon_EA: Any = None, outside: Any = 0.0
    ) -> Winches:
        """Return what holds the tendons, checked; see settle for the arguments.

        Raises InputError, naming the tendon where it is about one.
        """
        left, held = _given(arm, lengths, "lengths")
        T, pulled = np.zeros(arm.n_tendons), np.zeros(arm.n_tendons, dtype=bool)
        if tensions is not None:
            T, pulled = _given(arm, tensions, "tensions")
        for j in np.flatnonzero(held == pulled):
            both, field = bool(held[j]), f"lengths[{j}] ({arm.tendon_name(int(j))})"
            value = f"{left[j]:g} m and a tension of {T[j]:g} N" if both else None
            allowed = "a length or a tension for each tendon, None or nan in place of the other"
            raise InputError(field, value, allowed)
        if tendon_EA is None:
            return cls(held, left, T, outside=not_negative("tendon_outside", outside))
        return cls(held, left, T, checked_EA(tendon_EA), not_negative("tendon_outside", outside))

    def lacks(self, lengths: Array, tensions: Array) -> Array:
        """Return what is left of each tendon beyond its path (n_tendons,); below 0 it lacks."""
        return np.asarray(self.lengths + self.stretch * tensions - lengths)


def checked_EA(value: Any) -> float:
    """Return the stiffness E A of tendons [N]; InputError unless it is above 0."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (is_number and SMALLEST <= value <= LARGEST):
        raise InputError("tendon_EA", value, "a number above 0 [N], or None")
    return float(value)


def _given(arm: Arm, values: Any, name: str) -> tuple[Array, NDArray[np.bool_]]:
    """Return a number for each tendon, 0 where there is None or nan, and where there is one."""
    try:
        parts = [np.array(row) for row in values]
        rows = [row.astype(float) for row in parts if row.dtype.kind in "iufO"]
    except (TypeError, ValueError):
        parts = rows = []
    if not rows or len(rows) < len(parts):  # no numbers: refused in a sentence
        return arm.flat(values, name), np.ones(arm.n_tendons, dtype=bool)
    filled = [np.nan_to_num(row, nan=0.0, posinf=np.inf, neginf=-np.inf) for row in rows]
    return arm.flat(filled, name), ~np.isnan(np.concatenate([row.ravel() for row in rows]))


def _along_tendons(arm: Arm) -> tuple[Stations, Array, Counts, Counts]:
    """Return Gauss points along the arm, and where tendons cross them: weights, points, tendons."""
    s, weights, active = graded(arm, _REST).points(3)
    at = stations(arm, s, active)
    place, tendon = np.nonzero(crossing(arm, at))
    return at, weights[place], place, tendon


@lru_cache(maxsize=64)
def rest_lengths(arm: Arm) -> Array:
    """Return the length of each tendon in the arm at rest (n_tendons,) [m].

    The integral of |t + Y' + kappa_0 x Y|, Y = y d, kappa_0 the arm's curvature at rest. Strokes
    count from there: what a winch has taken in.
    """
    at, weights, place, tendon = _along_tendons(arm)
    n, b, *slope = tendon_paths(arm, at, place, tendon)
    bent = at.rest[0, place] * b - at.rest[1, place] * n if arm.is_curved else np.zeros(place.size)
    speed = np.sqrt((1 + bent) ** 2 + slope[0] ** 2 + slope[1] ** 2)
    result = np.asarray(np.bincount(tendon, weights * speed, arm.n_tendons), dtype=float)
    result.setflags(write=False)
    return result


def pulls(arm: Arm, tensions: Array) -> NDArray[np.bool_]:
    """Return which tendons pull, of tensions (..., n_tendons) [N]; the others are slack.

    A tendon is slack below 1e-8 L / C, with C the compliance of all tendons, see arm_compliance:
    less than that moves the arm by rounding alone.
    """
    return np.asarray(tensions > _PULLS * arm.length / arm_compliance(arm))


@lru_cache(maxsize=64)
def arm_compliance(arm: Arm) -> float:
    """Return how much all tendons shorten, in sum, for one newton in each, arm at rest [m/N].

    The straight arm's own compliance: integrals of y2/EJ + 1/EA.
    """
    at, weights, place, tendon = _along_tendons(arm)
    y, (EA, EJ, _) = at.y[np.array(arm.offset_of)[tendon], place], at.body[:, place]
    return float(weights @ (y**2 / EJ + 1 / EA))


def least_compliance(arm: Arm) -> float:
    """Return the compliance that tendons have at least where their lengths are held [m/N].

    It regularises what lengths do not determine: a share of the arm's own, below what matters.
    """
    return _LEAST_COMPLIANCE * arm_compliance(arm)


def slackened(tensions: Array, left: Array, winches: Winches, arm: Arm) -> Array:
    """Return tensions of an interior point, 0 of tendons that have more left than they pull."""
    slack = winches.held & (arm_compliance(arm) * tensions < left)
    return np.where(slack, 0.0, tensions)


# What rounding leaves of lengths, over the arm's length.
ROUNDING = 3e-14
# The weight of the norm beside what has to be met: its square is above rounding.
_LEAST_NORM = 1e-5


def least(M: Array, w: Array, z: Array, rounding: float) -> Array:
    """Return z >= 0 (n,) after a Newton step to w = 0, w (n,) changing with z as M (n, n) says.

    In the null space of M, directions that change w by less than `rounding` among it, z is of least
    norm. Components that would go below 0 stay there, first those that come there first; then those
    at 0 that keep others from w = 0.
    """
    free = np.ones(z.size, dtype=bool)
    while free.any():
        result = np.zeros(z.size)
        result[free] = _least(M[np.ix_(free, free)], w[free], z[free], rounding)
        below, left = result < 0, w + M @ (result - z)
        loose = free & (result == 0) & (left > rounding)
        apart = bool((np.abs(left[result > 0]) > rounding).any())
        if not below.any() and not (apart and loose.any()):
            return result
        if not below.any():
            free &= ~loose
            continue
        shares = np.where(below, z / np.where(below, z - result, 1.0), 1.0)
        blocked, before = shares <= shares.min(), z
        z = np.where(blocked, 0.0, z + shares.min() * (result - z))
        w = w + M @ (z - before)
        free &= ~blocked
    return np.zeros(z.size)


def _least(M: Array, w: Array, z: Array, rounding: float) -> Array:
    """Return z of least norm after the step; below 0 where no such z avoids it; see least.

    Which components are 0 is told by non-negative least squares: Lawson and Hanson, Solving Least
    Squares Problems (1974), chapter 23.
    """
    left, values, right = np.linalg.svd(M)
    most = max(float(np.abs(z).max()), float(np.abs(w).max()) / max(float(values[0]), 1e-300))
    felt = values * most > rounding
    rows, wanted = right[felt], right[felt] @ z - (w @ left[:, felt]) / values[felt]
    result = wanted @ rows
    if result.min() >= 0 or felt.all():
        return np.asarray(result)
    with_norm = np.vstack([rows, _LEAST_NORM * np.eye(z.size)])
    pulled = scipy.optimize.nnls(with_norm, np.append(wanted, 0 * z))[0] > 0
    raised = np.zeros(z.size)
    raised[pulled] = np.linalg.lstsq(rows[:, pulled], wanted)[0]
    is_met = np.linalg.norm(rows @ raised - wanted) <= ROUNDING * np.linalg.norm(wanted)
    return np.maximum(raised, 0.0) if is_met else np.asarray(result)


# Combinations of tensions that change lengths by less than this share of what others do.
FELT = 1e-9


def unfelt(M: Array) -> Array:
    """Return the combinations (k, n) of tensions that lengths, by M (n, n), do not feel."""
    _, values, right = np.linalg.svd(M)
    return np.asarray(right[values <= FELT * values.max(initial=0.0)])
