"""Levenberg and Marquardt's method for many points together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from model.paths import Array
from model.time_limit import check_time

_STEPS, _DONE = 16, 1e-6
# Of those that are not there yet so many of the farthest are left at each step, but not all: what
# comes to nothing shows early.
_LEFT, _FEWEST = 0.2, 16
# What came nearer by less than this part in so many steps is stuck, and is left where it is.
_NEARER, _STUCK = 0.3, 4
_DIFFERENCE = 1e-4
# Of the derivatives squared; what is less does not keep a system from being singular.
_ROUNDING = 1e-12


def least_squares(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the norms there (m,).

    Gaps are a function of points (m, n) -> (m, k).
    """
    U, r, damping = U.copy(), gaps(U), np.full(len(U), 1e-2)
    sizes, on = [np.linalg.norm(r, axis=1)], np.arange(len(U))
    for _ in range(_STEPS):
        check_time()
        size = sizes[-1][on]
        before = sizes[-1 - _STUCK][on] if len(sizes) > _STUCK else np.inf
        on = on[(size > _DONE) & (size < (1 - _NEARER) * before)]
        most = max(_FEWEST, round((1 - _LEFT) ** (len(sizes) - 1) * len(U)))
        on = np.sort(on[np.argsort(sizes[-1][on], kind="stable")[:most]])
        if not on.size:
            break
        trial = U[on] + _step(gaps, U[on], r[on], damping[on])
        tried = gaps(trial)
        better = np.linalg.norm(tried, axis=1) < np.linalg.norm(r[on], axis=1)
        for now, new in ((U, trial), (r, tried)):
            now[on] = np.where(better[:, None], new, now[on])
        damping[on] = np.maximum(damping[on] * np.where(better, 0.2, 8.0), 1e-8)
        sizes.append(np.linalg.norm(r, axis=1))
    return U, sizes[-1]


def _step(gaps: Callable[[Array], Array], U: Array, r: Array, damping: Array) -> Array:
    """Return the damped steps (m, n) of Gauss and Newton's method, scaled, none far."""
    m, n = U.shape
    scale = 1 + np.abs(U)
    h = _DIFFERENCE * scale
    shifted = gaps((U[:, None, :] + h[:, :, None] * np.eye(n)).reshape(-1, n)).reshape(m, n, -1)
    jacobian = (shifted - r[:, None, :]) / _DIFFERENCE
    normal = jacobian @ jacobian.transpose(0, 2, 1)
    damping = damping + _ROUNDING * np.trace(normal, axis1=1, axis2=2)
    normal += damping[:, None, None] * np.eye(n)
    step = -np.linalg.solve(normal, jacobian @ r[:, :, None])[:, :, 0]
    return np.asarray(np.clip(step, -1, 1) * scale)
