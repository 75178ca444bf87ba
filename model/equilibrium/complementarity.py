"""Linear complementarity: which tendons are taut once the equations are linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.paths import Array

# Exchanges of all wrong signs at once that may fail to lessen their number; then one at a time.
_BLOCKS = 8
# Rounding, against the largest number of its kind.
_TINY = 1e-14
# Combinations of tensions that change lengths by less than this share of what others do.
_IDLE = 1e-15


def complementary(M: Array, q: Array, taut: NDArray[np.bool_]) -> Array | None:
    """Return z (n,) with z >= 0, w = M z + q >= 0 and z . w = 0; None where none is found.

    By block principal pivoting (Judice and Pires, Computers & Operations Research 21, 1994), which
    comes to the one solution if all principal minors of M are positive. `taut` (n,) is a guess of
    which z are positive.
    """
    n = q.size
    fewest, blocks = n + 1, _BLOCKS
    for _ in range(100 + 10 * n):
        z, w = np.zeros(n), q
        own = np.flatnonzero(taut)
        if own.size:
            try:
                z[own] = np.linalg.solve(M[own[:, None], own], -q[own])
            except np.linalg.LinAlgError:
                return None
            w = M @ z + q
        least = -_TINY * np.abs(z).max(initial=0.0), -_TINY * np.abs(q).max(initial=0.0)
        wrong = np.where(taut, z < least[0], w < least[1])
        count = int(wrong.sum())
        if count == 0:
            return np.maximum(z, 0.0)
        if count < fewest:
            fewest, blocks = count, _BLOCKS
        elif blocks:
            blocks -= 1
        else:
            wrong = np.arange(n) == np.flatnonzero(wrong)[-1]
        taut = taut ^ wrong
    return None


def determined(M: Array, w: Array, z: Array, least: Array) -> Array:
    """Return z (n,) after a Newton step to w = 0, w (n,) changing with z as M (n, n) says.

    Combinations that M does not feel are as `least` has them.
    """
    left, values, right = np.linalg.svd(M)
    felt = values > _IDLE * values.max(initial=0.0)
    change = right[felt].T @ ((left[:, felt].T @ -w) / values[felt])
    return np.asarray(z + change - right[~felt].T @ (right[~felt] @ (z - least)))


def unfelt(M: Array, share: float) -> Array:
    """Return the combinations (k, n) that M (n, n) feels less than by a share of its largest."""
    _, values, right = np.linalg.svd(M)
    return np.asarray(right[values <= share * values.max(initial=0.0)])
