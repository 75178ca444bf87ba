"""First guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too, and an arm may
wind up in many ways. So some of very many drawn bends, those nearest to what is wanted, are driven
to it by least squares, all together, on the coarsest mesh, in a scene without loads whose strains
are closed forms. What is met in several ways is met by several of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.effects import Extension
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from planner.initial_guess.many_arms import BendCoordinates, bend_coordinates, residuals
from planner.program.limits import Limits
from planner.targets.base import Target

# How many are drawn, and how many of those are fitted: the work of a step grows with the square of
# the number of bends, so many are affordable.
_DRAWN, _FITTED, _DIFFERENCES = 4000, 160, 1000
# Where sections shorten, some of those that bends do not bring there are squeezed as well.
_SQUEEZED = 30
# What is nearer is met but for the errors of the mesh; what is not may be a place to get stuck.
_MET = 3e-3
_SAME = 0.05


@dataclass(frozen=True, eq=False)
class Fitting:
    """Least squares over the bends of an arm, for targets in a scene without loads."""

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    bends: BendCoordinates
    machine_code: bool

    def gaps(self, points: Array) -> Array:
        """Return residuals of targets, and of a body that is crushed, at bends (m, n)."""
        question = self.arm, self.scene, self.targets
        return residuals(*question, self.bends.tensions(points), self.machine_code)

    def fit(self) -> tuple[Array, Array]:
        """Return bends (m, n) fitted from drawn ones; residuals (m,)."""
        drawn = self.bends.draw(_DRAWN)
        residuals_drawn = self.gaps(drawn)
        nearest = np.argsort(np.linalg.norm(residuals_drawn, axis=1), kind="stable")
        points = drawn[nearest[: max(4, min(_FITTED, _DIFFERENCES // self.bends.width))]]
        points, residual = least_squares(self.gaps, points)
        redundant = self.bends.width > residuals_drawn.shape[1] - 1 and bool(
            (residual < _MET).any()
        )
        if self.scene.has(Extension) and not redundant:
            points = self._squeezed(points, residual)
        return points, residual

    def _squeezed(self, points: Array, residual: Array) -> Array:
        """Return bends and squeezes (m, 3 n): what nearly meets the targets may do so squeezed.

        Residuals are brought up to date.
        """
        points = np.hstack([points, np.zeros((len(points), len(self.bends.sections)))])
        order = self.different(points, residual)
        near = [i for i in order if residual[i] >= _MET][:_SQUEEZED]
        if near:
            points[near], residual[near] = least_squares(self.gaps, points[near])
        return points

    def different(self, points: Array, residual: Array) -> list[int]:
        """Return which differ from those before: the cheapest that meet, then the nearest."""
        T, met = self.bends.tensions(points), residual < _MET
        order = np.lexsort([np.where(met, np.linalg.norm(T, axis=1), residual), ~met])
        T = T[order]
        same = _distances(T) <= _SAME * np.abs(T).max(axis=1, keepdims=True)
        kept = np.zeros(len(T), dtype=bool)
        for i in range(len(T)):
            kept[i] = not (same[i] & kept).any()
        return [int(i) for i in order[kept]]


def fitted(
    arm: Arm, scene: Scene, targets: tuple[Target, ...], limits: Limits, machine_code: bool
) -> list[Array]:
    """Return tensions (n_tendons,) fitted to targets: the cheapest that meet them first.

    Then those that come nearest.
    """
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    bends = bend_coordinates(arm, tendons, limits)
    fitting = Fitting(arm, scene, targets, bends, machine_code)
    points, residual = fitting.fit()
    return list(bends.tensions(points)[fitting.different(points, residual)])


def _distances(T: Array) -> Array:
    """Return the largest differences (m, m) between rows (m, n)."""
    largest = np.zeros((len(T), len(T)))
    for column in T.T:
        np.maximum(largest, np.abs(column[:, None] - column), out=largest)
    return largest


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
        earlier = sizes[-1 - _STUCK][on] if len(sizes) > _STUCK else np.inf
        on = on[(size > _DONE) & (size < (1 - _NEARER) * earlier)]
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
