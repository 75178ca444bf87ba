"""First guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too. So some of very
many drawn bends, those nearest to what is wanted, are driven to it by Levenberg and Marquardt's
method, all together, on the coarsest mesh. What is met in several ways is met by several of them;
the cheapest comes first. The draws are the same each time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.arm import Arm
from model.effects import ExactTendons, NeoHookean
from model.paths import Array
from planner.program.limits import Limits
from planner.program.problem import Problem
from planner.solve.residuals import Residuals
from planner.solve.starts import section_pulls
from planner.targets.base import Target

# How many are drawn and fitted; fewer where each section takes a Newton's method to settle.
_COUNTS, _COUNTS_IF_SLOW = (1000, 40), (600, 16)
_STEPS = 10
# The work of a step grows with the square of the number of bends; so many slopes are affordable.
_SLOPES = 300
# In units of what bends the arm by about 1 rad; a slender tip saturates, so it takes many.
_LEAST, _MOST_AT_TIP, _MOST_AT_BASE = 0.15, 20.0, 5.0
# What is nearer is met but for the errors of the mesh; what is not may be a place to get stuck.
_MET = 3e-3
_SAME = 0.05
# A fit much dearer than the cheapest one leads to a dearer optimum.
_DEARER = 2.0
_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Bends:
    """The pulls of the sections as a function of their bends: two numbers for each section."""

    arm: Arm
    tendons: frozenset[int]
    limits: Limits

    @cached_property
    def sections(self) -> list[int]:
        """The sections with tendons that may pull, tip first."""
        return sorted({self.arm.tendons[j][0] for j in self.tendons})

    @cached_property
    def sides(self) -> Array:
        """Tensions (2 n, 2, n_tendons) that bend each section along an axis, there and back."""
        angles = [(0.0, np.pi), (np.pi / 2, -np.pi / 2)]
        return np.array(
            [
                [section_pulls(self.arm, i, angle, self.tendons) for angle in axis]
                for i in self.sections
                for axis in angles
            ]
        )

    def tensions(self, bends: Array) -> Array:
        """Return tensions (m, n_tendons) of bends (m, 2 n), within the limits of each tendon."""
        T = np.maximum(bends, 0) @ self.sides[:, 0] + np.maximum(-bends, 0) @ self.sides[:, 1]
        return np.asarray(np.clip(T, self.limits.lower, self.limits.upper))

    def draw(self, count: int) -> Array:
        """Return bends (count, 2 n), half of them small ones, in all directions."""
        rng, n = np.random.default_rng(0), len(self.sections)
        most = np.linspace(_MOST_AT_TIP, _MOST_AT_BASE, n) if n > 1 else np.array([_MOST_AT_TIP])
        share = rng.uniform(size=(count, n))
        few = np.arange(count)[:, None] % 2 == 0
        size = np.where(few, _LEAST * (most / _LEAST) ** share, most * share)
        angle = rng.uniform(0, 2 * np.pi, size=(count, n))
        return np.stack([size * np.cos(angle), size * np.sin(angle)], axis=2).reshape(count, -1)


def fits(
    problem: Problem, targets: tuple[Target, ...], limits: Limits, share: float = 1.0
) -> tuple[list[Array], list[Array]]:
    """Return tensions that meet the targets, cheapest first, and other ones, nearest first.

    Those that meet them at far more effort than the cheapest are left to the other ones. `share` is
    how many are drawn and fitted, of the usual number.
    """
    tendons = frozenset.intersection(*(target.tendons(problem.arm) for target in targets))
    bends = Bends(problem.arm, tendons, limits)
    residuals = Residuals(problem, targets)

    def gaps(points: Array) -> Array:
        found, crushed = residuals(bends.tensions(points))
        return np.hstack([found, 10 * crushed[:, None]])

    slow = problem.scene.has(ExactTendons) or problem.scene.has(NeoHookean)
    draws, most = _COUNTS_IF_SLOW if slow else _COUNTS
    drawn = bends.draw(round(share * draws))
    nearest = np.argsort(np.linalg.norm(gaps(drawn), axis=1), kind="stable")
    count = max(4, round(share * min(most, _SLOPES // drawn.shape[1])))
    points, residual = _fitted(gaps, drawn[nearest[:count]])
    T = bends.tensions(points)
    order = _different(T, residual)
    cost = np.linalg.norm(T[order], axis=1)
    cheap = (residual[order] < _MET) & (cost <= _DEARER * cost[0])
    leading = [T[i] for i, kept in zip(order, cheap, strict=True) if kept]
    others = [(residual[i], i) for i, kept in zip(order, cheap, strict=True) if not kept]
    return leading, [T[i] for _, i in sorted(others)]


def _different(T: Array, residual: Array) -> list[int]:
    """Return which tensions differ from those before: the cheapest that meet, then the nearest."""
    met = residual < _MET
    order = np.lexsort([np.where(met, np.linalg.norm(T, axis=1), residual), ~met])
    kept: list[int] = []
    for i in order:
        if all(np.abs(T[i] - T[j]).max() > _SAME * np.abs(T[i]).max() for j in kept):
            kept.append(int(i))
    return kept


def _fitted(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the norms there (m,)."""
    m, n = U.shape
    damping, r = np.full(m, 1e-2), gaps(U)
    for _ in range(_STEPS):
        h = _DIFFERENCE * (1 + np.abs(U))
        shifted = U[:, None, :] + h[:, :, None] * np.eye(n)
        slopes = (gaps(shifted.reshape(-1, n)).reshape(m, n, -1) - r[:, None, :]) / h[:, :, None]
        scale = 1 + np.abs(U)
        A = slopes * scale[:, :, None]
        normal = A @ A.transpose(0, 2, 1) + damping[:, None, None] * np.eye(n)
        step = -np.linalg.solve(normal, A @ r[:, :, None])[:, :, 0]
        trial = U + np.clip(step, -1, 1) * scale
        tried = gaps(trial)
        better = np.linalg.norm(tried, axis=1) < np.linalg.norm(r, axis=1)
        U, r = (np.where(better[:, None], a, b) for a, b in ((trial, U), (tried, r)))
        damping = np.maximum(damping * np.where(better, 0.2, 8.0), 1e-8)
    return U, np.linalg.norm(r, axis=1)
