"""First guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too, and there are many
ways to wind up. So some of very many drawn bends, those nearest to what is wanted, are driven to it
by Levenberg and Marquardt's method, all together, on the coarsest mesh. What is met in several ways
is met by several of them. Where a section takes a Newton's method to settle, most of that is done
without what calls for it, and what was found is fitted once more with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.effects import ExactTendons, Extension, NeoHookean
from model.paths import Array
from model.scene import Scene
from planner.program.effort import effort
from planner.program.limits import Limits
from planner.program.problem import Problem, build
from planner.solve.bends import Bends
from planner.solve.residuals import Residuals
from planner.targets.base import Target

# How many are drawn, and how many of those are fitted.
Count = tuple[int, int]
COUNT, COUNT_OF_POINT = (4000, 160), (300, 12)
# Of them where each section takes a Newton's method to settle, as far as they are not fits of
# simpler statics, of which there are so many at most.
_SLOW, _AGAIN = 0.25, 16
_STEPS = 16
# Where sections shorten, some of those that bends do not bring there are squeezed as well.
_SQUEEZED = 30
# The work of a step grows with the square of the number of bends; so many slopes are affordable.
_SLOPES = 1000
# What is nearer is met but for the errors of the mesh; what is not may be a place to get stuck.
_MET, _DONE = 3e-3, 1e-6
_SAME = 0.05
# A fit so much dearer than the cheapest one leads to a dearer optimum.
_DEARER = 1.3
_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Fits:
    """Tensions that differ: those that meet the targets, cheapest first, and the nearest others.

    Attributes
    ----------
    likely : list of (n_tendons,)
        Among them is the one that leads to the best optimum: they cost little more than the
        cheapest. None where there are more bends than numbers to meet, so that what meets them is
        not one of a few.
    others : list of (n_tendons,)
        Those that meet the targets come first.
    """

    likely: list[Array]
    others: list[Array]


def fits(problem: Problem, targets: tuple[Target, ...], limits: Limits, count: Count) -> Fits:
    """Return tensions fitted to targets, from so many that are drawn, so many of them fitted."""
    tendons = frozenset.intersection(*(target.tendons(problem.arm) for target in targets))
    bends = Bends(problem.arm, tendons, limits)
    simple = _closed_form(problem.scene)
    if simple == problem.scene:
        points, residual = _fit(problem, targets, bends, count)
    else:
        easy = build(problem.arm, targets, simple, problem.statement)
        points, residual = _fit(easy, targets, bends, count)
        again = points[:, : len(bends.sides)][
            _different(bends.tensions(points), residual, problem)[:_AGAIN]
        ]
        less = (round(_SLOW * count[0]), round(_SLOW * count[1]))
        points, residual = _fit(problem, targets, bends, less, again)
    T = bends.tensions(points)
    order = _different(T, residual, problem)
    met = [i for i in order if residual[i] < _MET]
    rows = problem.terms.numel_out(0) + problem.terms.numel_out(1)
    few = bool(met) and len(bends.sides) <= rows
    most = _DEARER * _cost(T[met[0]], problem) if few else 0.0
    likely = [i for i in met if _cost(T[i], problem) <= most]
    return Fits([T[i] for i in likely], [T[i] for i in order[len(likely) :]])


def _closed_form(scene: Scene) -> Scene:
    """Return the scene without what a section takes a Newton's method to settle for."""
    slow = (ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if not isinstance(effect, slow)))


def _cost(T: Array, problem: Problem) -> float:
    return effort(T, problem.statement.norm)


def _fit(
    problem: Problem,
    targets: tuple[Target, ...],
    bends: Bends,
    count: Count,
    first: Array | None = None,
) -> tuple[Array, Array]:
    """Return bends (m, n) fitted to targets, from those given and from drawn ones; residuals."""
    residuals = Residuals(problem, targets)

    def gaps(points: Array) -> Array:
        found, crushed = residuals(bends.tensions(points))
        return np.hstack([found, 10 * crushed[:, None]])

    drawn = bends.draw(count[0])
    nearest = np.argsort(np.linalg.norm(gaps(drawn), axis=1), kind="stable")
    kept = drawn[nearest[: max(4, min(count[1], _SLOPES // drawn.shape[1]))]]
    points, residual = least_squares(gaps, kept if first is None else np.vstack([first, kept]))
    if problem.scene.has(Extension):
        points, residual = _squeezed(gaps, points, residual, bends, problem)
    return points, residual


def _squeezed(
    gaps: Callable[[Array], Array], points: Array, residual: Array, bends: Bends, problem: Problem
) -> tuple[Array, Array]:
    """Return bends and squeezes (m, 3 n): what nearly meets the targets may do so squeezed."""
    points = np.hstack([points, np.zeros((len(points), len(bends.sections)))])
    order = _different(bends.tensions(points), residual, problem)
    near = [i for i in order if residual[i] >= _MET][:_SQUEEZED]
    if near:
        points[near], residual[near] = least_squares(gaps, points[near])
    return points, residual


def _different(T: Array, residual: Array, problem: Problem) -> list[int]:
    """Return which tensions differ from those before: the cheapest that meet, then the nearest."""
    met = residual < _MET
    cost = [_cost(one, problem) for one in T]
    kept: list[int] = []
    for i in np.lexsort([np.where(met, cost, residual), ~met]):
        if all(np.abs(T[i] - T[j]).max() > _SAME * np.abs(T[i]).max() for j in kept):
            kept.append(int(i))
    return kept


def least_squares(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the norms there (m,)."""
    U, r, damping = U.copy(), gaps(U), np.full(len(U), 1e-2)
    for _ in range(_STEPS):
        on = np.linalg.norm(r, axis=1) > _DONE
        if not on.any():
            break
        trial = U[on] + _step(gaps, U[on], r[on], damping[on])
        tried = gaps(trial)
        better = np.linalg.norm(tried, axis=1) < np.linalg.norm(r[on], axis=1)
        for now, new in ((U, trial), (r, tried)):
            now[on] = np.where(better[:, None], new, now[on])
        damping[on] = np.maximum(damping[on] * np.where(better, 0.2, 8.0), 1e-8)
    return U, np.linalg.norm(r, axis=1)


def _step(gaps: Callable[[Array], Array], U: Array, r: Array, damping: Array) -> Array:
    """Return the damped steps (m, n) of Gauss and Newton's method, scaled, none far."""
    m, n = U.shape
    scale = 1 + np.abs(U)
    h = _DIFFERENCE * scale
    shifted = gaps((U[:, None, :] + h[:, :, None] * np.eye(n)).reshape(-1, n)).reshape(m, n, -1)
    slopes = (shifted - r[:, None, :]) / _DIFFERENCE
    normal = slopes @ slopes.transpose(0, 2, 1) + damping[:, None, None] * np.eye(n)
    step = -np.linalg.solve(normal, slopes @ r[:, :, None])[:, :, 0]
    return np.asarray(np.clip(step, -1, 1) * scale)
