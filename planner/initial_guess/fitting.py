"""Initial guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too, and an arm may
wind up in many ways. So those of many drawn bends that are nearest to what is wanted are driven to
it by least squares, all together, on the coarsest mesh, in a scene without loads whose strains are
closed forms. What is met in several ways is met by several of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from model.effects import Extension
from model.paths import Array
from model.time_limit import check_time
from planner.initial_guess.many_arms import BendCoordinates, residuals
from planner.program.terms import pulling_tendons
from planner.solve.task import Task

# How many are drawn, and fitted; what is nearer is met but for the errors of the mesh.
_DRAWN, _FITTED, _MET = 4000, 60, 3e-3
# Tensions that differ by less, over the largest, are one guess.
_SAME = 0.05
# Steps of least squares, and those of differences, over the size of a bend.
_STEPS, _DIFFERENCE = 10, 1e-4
# Of the derivatives squared; what is less does not keep a system from being singular.
_ROUNDING = 1e-12


def fitted(task: Task) -> Array:
    """Return tensions (m, n_tendons) fitted to targets: the cheapest that meet them first.

    Then those that come nearest. Those that hardly differ from one before are left out. Where
    sections shorten, how hard all tendons of a section pull is fitted beside its bends.
    """
    bends = BendCoordinates(task.arm, pulling_tendons(task.arm, task.targets), task.allowed)

    def gaps(points: Array) -> Array:
        return residuals(task, bends.tensions(points))

    drawn = bends.draw(_DRAWN)
    nearest = np.argsort(np.linalg.norm(gaps(drawn), axis=1), kind="stable")[:_FITTED]
    points = drawn[nearest]
    if task.scene.has(Extension):
        points = np.hstack([points, np.zeros((len(points), len(bends.sections)))])
    points, residual = least_squares(gaps, points)
    T, met = bends.tensions(points), residual < _MET
    T = T[np.lexsort([np.where(met, np.linalg.norm(T, axis=1), residual), ~met])]
    apart = np.abs(T[:, None] - T).max(axis=2)
    same = apart <= _SAME * np.abs(T).max(axis=1, keepdims=True)
    kept = np.zeros(len(T), dtype=bool)
    for i in range(len(T)):
        kept[i] = not (same[i] & kept).any()
    return np.asarray(T[kept])


def least_squares(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the norms there (m,).

    Gaps are a function of points (m, n) -> (m, k). All that do not meet them yet take the steps of
    Levenberg and Marquardt's method side by side; derivatives at a point come in one call with its
    gaps.
    """
    U, damping = U.copy(), np.full(len(U), 1e-2)
    r, J = _linearised(gaps, U)
    for _ in range(_STEPS):
        check_time()
        far = np.flatnonzero(np.linalg.norm(r, axis=1) >= _MET)
        if not far.size:
            break
        trial = U[far] + _step(U[far], r[far], J[far], damping[far])
        r_trial, J_trial = _linearised(gaps, trial)
        better = np.linalg.norm(r_trial, axis=1) < np.linalg.norm(r[far], axis=1)
        taken = far[better]
        U[taken], r[taken], J[taken] = trial[better], r_trial[better], J_trial[better]
        damping[far] = np.maximum(damping[far] * np.where(better, 0.2, 8.0), 1e-8)
    return U, np.linalg.norm(r, axis=1)


def _linearised(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return gaps (m, k) and their derivatives (m, n, k) by U (m, n), by scaled differences."""
    m, n = U.shape
    shifts = np.vstack([np.zeros(n), _DIFFERENCE * np.eye(n)])
    shifted = U[:, None, :] + shifts * (1 + np.abs(U))[:, None, :]
    values = gaps(shifted.reshape(-1, n)).reshape(m, n + 1, -1)
    return values[:, 0].copy(), (values[:, 1:] - values[:, :1]) / _DIFFERENCE


def _step(U: Array, r: Array, J: Array, damping: Array) -> Array:
    """Return the damped steps (m, n) of Gauss and Newton's method, none far."""
    normal = J @ J.transpose(0, 2, 1)
    damping = damping + _ROUNDING * np.trace(normal, axis1=1, axis2=2)
    normal += damping[:, None, None] * np.eye(U.shape[1])
    step = -np.linalg.solve(normal, J @ r[:, :, None])[:, :, 0]
    return np.asarray(np.clip(step, -1, 1) * (1 + np.abs(U)))
