"""Winches, which hold tendon lengths or tensions, and Newton steps for nonnegative tensions.

Undetermined tensions have least norm.
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
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.value import NotNegative, Tension, value
from octoplan.model.tendons import arm_compliance, checked_EA


@value
class WinchSettings:
    """Zeros of winches, and stretch of their tendons.

    Attributes
    ----------
    zero : (n_tendons,)
        Length of each tendon taken in since the straight arm at rest if the encoder of strokes
        reads 0 [m]. An encoder of lengths reads too much by as much. Empty for 0.
    tendon_EA : float or None
        Axial stiffness E A of the tendons [N]; None for inextensible tendons.
    outside : float
        Length of each tendon between winch and base [m].
    """

    zero: tuple[float, ...] = ()
    tendon_EA: Tension | None = None
    outside: NotNegative = 0.0


# Winches with zeros of 0 and inextensible tendons.
PLAIN_WINCHES = WinchSettings()


@dataclass(frozen=True, eq=False)
class Winches:
    """Tendon lengths that winches hold, and tensions of the other tendons.

    A tendon with path length l in the arm satisfies l <= length + stretch T and T >= 0, one of
    these with equality: the tendon is taut, or slack.

    Attributes
    ----------
    held : (n_tendons,)
        Whether a winch holds a length; otherwise a force holds the tension.
    lengths : (n_tendons,)
        Unstretched length between base and anchorage [m]; 0 for tendons with given tension.
    tensions : (n_tendons,)
        [N]; 0 for tendons with given length.
    tendon_EA : float
        Axial stiffness of the tendons [N]; inf for inextensible tendons.
    outside : float
        Length of each tendon between winch and base [m].
    """

    held: Mask
    lengths: Array
    tensions: Array
    tendon_EA: float = np.inf
    outside: float = 0.0

    @property
    def stretch(self) -> Array:
        """Compliance of each tendon (n_tendons,) [m/N]."""
        return np.asarray(np.where(self.held, (self.lengths + self.outside) / self.tendon_EA, 0.0))

    @classmethod
    def of(
        cls, arm: Arm, tensions: Any, lengths: Any, tendon_EA: Any = None, outside: Any = 0.0
    ) -> Winches:
        """Return the winches of an arm; see settle for the arguments.

        Raises InputError, with the name of the tendon if the error belongs to one.
        """
        left, held = split_missing(arm, lengths, "lengths")
        T = np.zeros(arm.n_tendons)
        pulled = np.zeros(arm.n_tendons, dtype=bool)
        if tensions is not None:
            T, pulled = split_missing(arm, tensions, "tensions")
        for j in np.flatnonzero(held == pulled):
            both = bool(held[j])
            field = f"lengths[{j}] ({arm.tendon_name(int(j))})"
            value = Described(f"{left[j]:g} m and a tension of {T[j]:g} N") if both else None
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
        """Return tendon lengths minus path lengths (n_tendons,) [m]; negative if too short."""
        return np.asarray(self.lengths + self.stretch * tensions - lengths)


def split_missing(arm: Arm, values: Any, name: str) -> tuple[Array, Mask]:
    """Return a value for each tendon, 0 for None and nan, and a mask of the given values."""
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
    """Return tensions of an interior point, with 0 for tendons whose slack exceeds their pull."""
    slack = winches.held & (arm_compliance(arm) * tensions < left)
    return np.where(slack, 0.0, tensions)


# Relative rounding error.
_TINY = 1e-14
# Rounding error of lengths, over the arm's length.
ROUNDING = 3e-14
# Relative singular values of dl/dT below which tensions are ill-conditioned.
WELL_CONDITIONED = 1e-8
# Relative singular values of dl/dT that count as zero.
RANK_TOL = 1e-9
# If no tensions reduce the residual, and it exceeds both bounds, a tendon must slacken: bound over
# rounding, and bound over the whole residual.
_KEPT = 10.0
_MOSTLY = 0.1


def nonnegative_step(M: Array, w: Array, z: Array, rounding: float) -> tuple[Array, bool]:
    """Return z >= 0 (n,) after a Newton step for w(z) = 0, with dw/dz = M (n, n).

    Also return whether the determined directions are well-conditioned. In the null space of M,
    which includes directions that change w by less than `rounding`, z has least norm. Components
    that would become negative are fixed at 0, in the order in which they reach 0.
    """
    free = np.ones(z.size, dtype=bool)
    well = True
    nothing = _TINY * float(z.max(initial=0.0))
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
            before = z
            blocked = shares <= share
            z = np.where(blocked, 0.0, z + share * (result - z))
            w = w + M @ (z - before)
        free &= ~blocked
    return np.zeros(z.size), well


def _least_norm(M: Array, w: Array, z: Array, rounding: float) -> tuple[Array, bool]:
    """Return z of least norm after the step, see nonnegative_step; some z may be negative.

    A component is negative if no nonnegative z exists. If a part of w remains that no step reduces,
    z is changed until one component, which w > 0 allows to slacken, is negative.

    Source for least distance programming: Lawson and Hanson, "Solving Least Squares Problems"
    (1974), 23.4.
    """
    left, values, right, _ = dgesdd(M)
    most = max(float(np.abs(z).max()), float(np.abs(w).max()) / max(float(values[0]), 1e-300))
    felt = values * most > rounding
    count = int(np.count_nonzero(felt))  # the largest are the first
    well = count == 0 or bool(values[count - 1] > WELL_CONDITIONED * values[0])
    # Limit each combination to the largest tension, beyond which the linearisation is useless.
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
