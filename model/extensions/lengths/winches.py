"""What holds the tendons of an arm: winches that leave them a length, or forces.

And Newton steps of tensions that cannot push, to the least ones where they are undetermined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from scipy.linalg.lapack import dgesdd

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Index
from octoplan.model.paths import Array, Mask
from octoplan.model.support.checks import not_negative
from octoplan.model.support.errors import InputError
from octoplan.model.tendons import arm_compliance, checked_EA


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

    held: Mask
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
        left, held = _split_missing(arm, lengths, "lengths")
        T, pulled = np.zeros(arm.n_tendons), np.zeros(arm.n_tendons, dtype=bool)
        if tensions is not None:
            T, pulled = _split_missing(arm, tensions, "tensions")
        for j in np.flatnonzero(held == pulled):
            both, field = bool(held[j]), f"lengths[{j}] ({arm.tendon_name(int(j))})"
            value = f"{left[j]:g} m and a tension of {T[j]:g} N" if both else None
            allowed = "a length or a tension for each tendon, None or nan in place of the other"
            raise InputError(field, value, allowed)
        EA = np.inf if tendon_EA is None else checked_EA(tendon_EA)
        return cls(held, left, T, EA, not_negative("tendon_outside", outside))

    def undetermined_tensions(self, taut: Index, length_tension: Array) -> Array:
        """Return the combinations (k, n) of the tensions of taut tendons that lengths leave free.

        `length_tension` (n, n) are the derivatives of the lengths of the n taut tendons by their
        tensions [m/N].
        """
        _, values, right = np.linalg.svd(np.diag(self.stretch[taut]) - length_tension)
        return np.asarray(right[values <= RANK_TOL * values.max(initial=0.0)])

    def slack_lengths(self, lengths: Array, tensions: Array) -> Array:
        """Return what is left of tendons beyond their paths (n_tendons,) [m]; short below 0."""
        return np.asarray(self.lengths + self.stretch * tensions - lengths)


def _split_missing(arm: Arm, values: Any, name: str) -> tuple[Array, Mask]:
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


def slackened(tensions: Array, left: Array, winches: Winches, arm: Arm) -> Array:
    """Return tensions of an interior point, 0 of tendons that have more left than they pull."""
    slack = winches.held & (arm_compliance(arm) * tensions < left)
    return np.where(slack, 0.0, tensions)


# Rounding, against the largest number of its kind.
_TINY = 1e-14
# What rounding leaves of lengths, over the arm's length.
ROUNDING = 3e-14
# Combinations of tensions that change lengths by less than these shares of what others do are not
# felt well, and not felt.
WELL_CONDITIONED, RANK_TOL = 1e-8, 1e-9
# What is left that no tensions change, over rounding and as a share of all that is left, where one
# of the tendons has to slacken.
_KEPT, _MOSTLY = 10.0, 0.1


def least(M: Array, w: Array, z: Array, rounding: float) -> tuple[Array, bool]:
    """Return z >= 0 (n,) after a Newton step to w = 0, w (n,) changing with z as M (n, n) says.

    And whether all that w tells apart it tells well. In the null space of M, directions that change
    w by less than `rounding` among it, z is of least norm. Components that would go below 0 stay
    there, first those that come there first.
    """
    free, well, nothing = np.ones(z.size, dtype=bool), True, _TINY * float(z.max(initial=0.0))
    while free.any():
        result = np.zeros(z.size)
        result[free], well = _least_norm(M[np.ix_(free, free)], w[free], z[free], rounding)
        below = result < 0
        if not below.any():
            return result, well
        blocked = below & (z <= nothing)
        if not blocked.any():
            shares = np.ones(z.size)
            shares[below] = z[below] / (z[below] - result[below])
            share = float(shares.min())
            before, blocked = z, shares <= share
            z = np.where(blocked, 0.0, z + share * (result - z))
            w = w + M @ (z - before)
        free &= ~blocked
    return np.zeros(z.size), well


def _least_norm(M: Array, w: Array, z: Array, rounding: float) -> tuple[Array, bool]:
    """Return z of least norm after the step; below 0 where no such z avoids it; see least.

    Also where w is left that no step changes: then z goes on until one of them, which w > 0 lets
    slacken, is below 0.

    Least distance programming: Lawson and Hanson, Solving Least Squares Problems (1974), 23.4.
    """
    left, values, right, _ = dgesdd(M)
    most = max(float(np.abs(z).max()), float(np.abs(w).max()) / max(float(values[0]), 1e-300))
    felt = values * most > rounding
    count = int(np.count_nonzero(felt))  # the largest are the first
    well = count == 0 or bool(values[count - 1] > WELL_CONDITIONED * values[0])
    # No combination changes by more than the largest tension: so far away w tells nothing of it.
    steps = ((w @ -left[:, :count]) / values[:count]).clip(-most, most)
    result = z + right[:count].T @ steps
    idle = right[count:]
    if not len(idle):
        return result, well
    apart = idle.T @ (idle @ w)
    if np.abs(apart).max() > max(_KEPT * rounding, _MOSTLY * float(np.abs(w).max())):
        falls = apart > 0
        until = np.maximum(z[falls], _TINY * most) / apart[falls]
        if until.size:
            return z - 2 * float(until.min()) * apart, well
    result = result - idle.T @ (idle @ result)
    if result.min() >= 0:
        return result, well
    size = float(np.abs(result).max())
    E = np.vstack([idle, -result / size])
    f = np.eye(len(E))[-1]
    r = E @ scipy.optimize.nnls(E, f)[0] - f
    if np.linalg.norm(r) <= RANK_TOL:  # inequalities exclude each other
        return result, well
    raises = idle.T @ (r[:-1] / (r @ r) * size)  # the last of r is -r.r, but for rounding
    if np.abs(raises).max() > most:
        return result, well
    raised = result + raises
    return np.where(np.abs(raised) <= _TINY * size, 0.0, raised), well
