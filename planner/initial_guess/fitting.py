"""First guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too, and there are many
ways to wind up. So some of very many drawn bends, those nearest to what is wanted, are driven to it
by least squares, all together, on the coarsest mesh. What is met in several ways is met by several
of them. Where a section takes a Newton's method to settle, most of that is done without what calls
for it, and what was found is fitted once more with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.effects import ExactTendons, Extension, NeoHookean
from model.paths import Array
from model.scene import Scene
from planner.initial_guess.bend_coordinates import BendCoordinates, bend_coordinates
from planner.initial_guess.least_squares import least_squares
from planner.initial_guess.residuals import Residuals
from planner.program.effort import effort
from planner.program.limits import Limits
from planner.program.problem import Problem, build
from planner.targets.base import Target

# How many are drawn, and how many of those are fitted.
Count = tuple[int, int]
COUNT, COUNT_OF_POINT = (4000, 160), (300, 12)
# Of them where each section takes a Newton's method to settle, as far as they are not fits of
# simpler statics, of which there are so many at most.
_SLOW, _AGAIN = 0.25, 16
# Where sections shorten, some of those that bends do not bring there are squeezed as well.
_SQUEEZED = 30
# The work of a step grows with the square of the number of bends; so many are affordable.
_DIFFERENCES = 1000
# What is nearer is met but for the errors of the mesh; what is not may be a place to get stuck.
_MET = 3e-3
_SAME = 0.05
# A fit so much more expensive than the cheapest one leads to a more expensive optimum.
_DEARER = 1.3


@dataclass(frozen=True, eq=False)
class FittedGuesses:
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


def fitted_guesses(
    problem: Problem, targets: tuple[Target, ...], limits: Limits, count: Count
) -> FittedGuesses:
    """Return tensions fitted to targets, from so many that are drawn, so many of them fitted."""
    tendons = frozenset.intersection(*(target.tendons(problem.arm) for target in targets))
    bends = bend_coordinates(problem.arm, tendons, limits)
    fitting, simple = Fitting(problem, targets, bends), _closed_form(problem.scene)
    if simple == problem.scene:
        points, residual = fitting.fit(count)
    else:
        stated = (simple, problem.statement, problem.machine_code)
        easy = Fitting(build(problem.arm, targets, *stated), targets, bends)
        points, residual = easy.fit(count)
        again = easy.different(points, residual)[:_AGAIN]
        less = (round(_SLOW * count[0]), round(_SLOW * count[1]))
        points, residual = fitting.fit(less, points[again, : bends.width])
    order, T = fitting.different(points, residual), bends.tensions(points)
    cost = fitting.cost(T)
    met = [i for i in order if residual[i] < _MET]
    most = _DEARER * cost[met[0]] if met and not fitting.redundant else 0.0
    likely = [i for i in met if cost[i] <= most]
    return FittedGuesses([T[i] for i in likely], [T[i] for i in order[len(likely) :]])


def _closed_form(scene: Scene) -> Scene:
    """Return the scene without what a section takes a Newton's method to settle for."""
    slow = (ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if not isinstance(effect, slow)))


class Fitting:
    """Least squares over the bends of an arm, for targets in a scene without loads."""

    def __init__(
        self, problem: Problem, targets: tuple[Target, ...], bends: BendCoordinates
    ) -> None:
        self.problem, self.bends, self.residuals = problem, bends, Residuals(problem, targets)

    @property
    def redundant(self) -> bool:
        """Whether there are more bends than numbers to meet: what meets them is not one of few."""
        terms = self.problem.terms
        return self.bends.width > terms.numel_out(0) + terms.numel_out(1)

    def gaps(self, points: Array) -> Array:
        """Return residuals of targets, and of a body that is crushed, at bends (m, n)."""
        found, crushed = self.residuals(self.bends.tensions(points))
        return np.hstack([found, 10 * crushed[:, None]])

    def fit(self, count: Count, first: Array | None = None) -> tuple[Array, Array]:
        """Return bends (m, n) fitted from those given and from drawn ones; residuals (m,)."""
        drawn = self.bends.draw(count[0])
        nearest = np.argsort(np.linalg.norm(self.gaps(drawn), axis=1), kind="stable")
        kept = drawn[nearest[: max(4, min(count[1], _DIFFERENCES // self.bends.width))]]
        points = kept if first is None else np.vstack([first, kept])
        points, residual = least_squares(self.gaps, points)
        enough = self.redundant and bool((residual < _MET).any())
        if self.problem.scene.has(Extension) and not enough:
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

    def cost(self, T: Array) -> Array:
        """Return the effort of tensions (m, n_tendons) [N]."""
        return effort(T, self.problem.statement.norm)

    def different(self, points: Array, residual: Array) -> list[int]:
        """Return which differ from those before: the cheapest that meet, then the nearest."""
        T, met = self.bends.tensions(points), residual < _MET
        order = np.lexsort([np.where(met, self.cost(T), residual), ~met])
        T = T[order]
        same = _distances(T) <= _SAME * np.abs(T).max(axis=1, keepdims=True)
        kept = np.zeros(len(T), dtype=bool)
        for i in range(len(T)):
            kept[i] = not (same[i] & kept).any()
        return [int(i) for i in order[kept]]


def _distances(T: Array) -> Array:
    """Return the largest differences (m, m) between rows (m, n)."""
    found = np.zeros((len(T), len(T)))
    for column in T.T:
        np.maximum(found, np.abs(column[:, None] - column), out=found)
    return found
