"""Newton steps of tensions that do not push, of the least ones where they are undetermined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from scipy.linalg.lapack import dgesdd

from model.paths import Array

# Rounding, against the largest number of its kind.
_TINY = 1e-14
# What rounding leaves of lengths, over the arm's length.
ROUNDING = 3e-14
# Combinations that are felt by less than this share of what others are, are not felt well.
_WELL = 1e-8
# A residual as small says that inequalities exclude each other.
_APART = 1e-9


class Step(NamedTuple):
    """What least returns.

    Attributes
    ----------
    z : (n,)
        z after the step.
    well : bool
        Whether all that w tells apart it tells well.
    whole : bool
        Whether the step was taken to its end; otherwise w is not 0 there.
    """

    z: Array
    well: bool
    whole: bool


def least(M: Array, w: Array, z: Array, rounding: float) -> Step:
    """Return z >= 0 (n,) after a Newton step to w = 0, w (n,) changing with z as M (n, n) says.

    Of the z that w does not tell apart, but for its `rounding`, those of least norm. A step that
    would lead below 0 ends there; what is at 0 and would go below stays.
    """
    if not z.size:
        return Step(z, True, True)
    found, well = _least(M, w, z, rounding)
    own = np.ones(z.size, dtype=bool)
    nothing = _TINY * float(z.max())
    while found.min() < 0:
        below = found < 0
        blocked = own & below & (z <= nothing)
        if not blocked.any():
            shares = np.ones(z.size)
            shares[below] = z[below] / (z[below] - found[below])
            share = float(shares.min())
            return Step(np.where(shares <= share, 0.0, z + share * (found - z)), well, False)
        own &= ~blocked
        if not own.any():
            return Step(np.zeros(z.size), well, True)
        found = np.zeros(z.size)
        found[own], well = _least(M[np.ix_(own, own)], w[own], z[own], rounding)
    return Step(found, well, True)


def _least(M: Array, w: Array, z: Array, rounding: float) -> tuple[Array, bool]:
    """Return z of least norm after the step; below 0 where no such z avoids it; see least.

    Least distance programming: Lawson and Hanson, Solving Least Squares Problems (1974), 23.4.
    """
    left, values, right, _ = dgesdd(M)
    most = max(float(np.abs(z).max()), float(np.abs(w).max()) / max(float(values[0]), 1e-300))
    felt = values * most > rounding
    count = int(np.count_nonzero(felt))  # the largest are the first
    well = count == 0 or bool(values[count - 1] > _WELL * values[0])
    found = z + right[:count].T @ ((w @ -left[:, :count]) / values[:count])
    idle = right[count:]
    if not len(idle):
        return found, well
    found = found - idle.T @ (idle @ found)
    if found.min() >= 0:
        return found, well
    size = float(np.abs(found).max())
    E = np.vstack([idle, -found / size])
    f = np.eye(len(E))[-1]
    r = E @ scipy.optimize.nnls(E, f)[0] - f
    if np.linalg.norm(r) <= _APART:
        return found, well
    raised = found + idle.T @ (r[:-1] / (r @ r) * size)  # the last of r is -r.r, but for rounding
    return np.where(np.abs(raised) <= _TINY * size, 0.0, raised), well


def unfelt(M: Array, share: float) -> Array:
    """Return the combinations (k, n) that M (n, n) feels less than by a share of its largest."""
    _, values, right = np.linalg.svd(M)
    return np.asarray(right[values <= share * values.max(initial=0.0)])
