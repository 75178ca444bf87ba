"""Settled shapes under tensions sampled over the limits, ordered by the distance to the targets.

A search that finds no shape for its targets continues from the nearest samples. All samples are
settled in one batch, in the scene of the plan and on the mesh of the search, so that loads, shear
and tendons that turn around the midline count. If tensions are raised in steps under strong loads,
the equilibrium of each step is a sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy.optimize import lsq_linear

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.forward import REFINEMENTS
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time, report
from octoplan.planner.limits import TendonLimits, natural_tensions
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program_instance import SEARCH_WEIGHT, ProgramInstance, tension_scales
from octoplan.planner.solve.guesses import FAR_APART, BendCoordinates, distinct, within_total
from octoplan.planner.targets.target_set import EQUALITY, INEQUALITY

# Number of sampled shapes without loads. At most half of them are corners of the box of tensions:
# 512 have all corners of eight tendons.
_SAMPLES = 512
# The same under loads: a shape takes ten times as long to settle.
_LOADED = 192
# Number of lines of tensions under strong loads. A line has about ten samples. The samples of 32
# lines are nearer to four of five tips than the ends of 192 lines, in a fifth of the time.
_LINES = 32
# Shapes that are settled at a time: the equations of so many stay in the processor's cache.
_AT_ONCE = 64
# Smallest sampled tension, in tensions that bend the arm by 1 rad.
_LEAST = 0.05
# Largest sampled tension, likewise. This tension bends a slender tip, and replaces an infinite
# limit.
_MOST = 60.0
# Tip error over the arm's length above which the mesh of the search is refined.
_TOLERANCE = 3e-3
# Share of the shapes that have to be so accurate: the others curl more than the mesh is worth.
_SHARE = 0.75
# Finest mesh of a search.
_FINEST = 8
# Number of steps of a fit.
_STEPS = 8
# First damping of a fit, and the damping at which a fit ends.
_DAMPING = 1e-3
_STIFF = 1e3
# Relative fall of the miss that counts as progress.
_FALL = 1e-2
# Miss at which a fit ends, in lengths and rad: the mesh is no better.
_MET = 1e-4
# Smallest room of a step: bounds of least squares must differ.
_TINY = 1e-12
# Bound of tensions without a limit, in units of the program.
_FAR = 1e3


@dataclass(frozen=True, eq=False)
class Samples:
    """Sampled shapes that settle.

    Attributes
    ----------
    problem : PlanningProblem
        The problem, with the mesh on which the nearest samples are accurate.
    count : int
        Number of sampled shapes, including samples that do not settle.
    points : list of Equilibrium
        The nearest to the targets first, on the mesh of the problem.
    objective : (m,)
        Objective of the nearest shape: the targets' own measure of the distance.
    """

    problem: PlanningProblem
    count: int
    points: list[Equilibrium]
    objective: Array

    @property
    def tensions(self) -> Array:
        """The tensions (m, n_tendons), the nearest to the targets first [N]."""
        rows = [point.tensions for point in self.points]
        return np.array(rows).reshape(-1, self.problem.arm.n_tendons)

    def distinct(self) -> Iterator[Equilibrium]:
        """Yield equilibria whose tensions differ, the nearest to the targets first."""
        tensions = self.tensions
        unit = tension_scales(self.problem.arm, self.problem.allowed)
        for T in distinct(tensions, unit, FAR_APART):
            yield self.points[int((tensions == T).all(axis=1).argmax())]


def sample(problem: PlanningProblem, n_nearest: int) -> Samples:
    """Return sampled shapes, on a mesh that is fine enough for the `n_nearest` nearest samples."""
    while True:
        samples = _settled(problem)
        nearest = [*islice(samples.distinct(), n_nearest)]
        on_finer = _finer(problem, nearest)
        if on_finer is problem:
            return samples
        problem = on_finer


def fine_enough(problem: PlanningProblem, tensions: Array) -> PlanningProblem:
    """Return the problem on a mesh that is accurate for most of the tensions (m, n_tendons)."""
    return _finer(
        problem, [*_points(ProgramInstance(problem, problem.coarse("nearest")), tensions)]
    )


def _finer(problem: PlanningProblem, points: Sequence[object]) -> PlanningProblem:
    """Return the problem on a mesh that is accurate for most of the equilibria; skip errors."""
    settled = [point for point in points if isinstance(point, Equilibrium)]
    while True:
        mesh = problem.coarse("nearest").refinement
        if mesh >= _FINEST or not settled:
            return problem
        on_finer = replace(problem, mesh=REFINEMENTS[REFINEMENTS.index(mesh) + 1])
        instance = ProgramInstance(on_finer, on_finer.coarse("nearest"))
        tensions = np.array([point.tensions for point in settled])
        # Loaded arms settle sooner from the shapes on the last mesh.
        ends = [
            *_points(instance, tensions, settled if is_coupled(problem.arm, problem.scene) else ())
        ]
        pairs = [
            (point, end)
            for point, end in zip(settled, ends, strict=True)
            if isinstance(end, Equilibrium)
        ]
        apart = [np.linalg.norm(end.poses[-1, 4:] - point.poses[-1, 4:]) for point, end in pairs]
        if not pairs or float(np.quantile(apart, _SHARE)) <= _TOLERANCE * problem.arm.length:
            return problem
        problem = on_finer
        settled = [end for _, end in pairs]


def _settled(problem: PlanningProblem) -> Samples:
    """Return the sampled shapes that settle on the mesh of a problem."""
    instance = ProgramInstance(problem, problem.coarse("nearest"))
    points, count = _equilibria(instance)
    p = instance.parameters(SEARCH_WEIGHT)
    taken = list[Equilibrium]()
    objectives = list[float]()
    for point in points:
        # Responses of an arm that buckles have no solution.
        with suppress(OctoplanError, np.linalg.LinAlgError):
            x = instance.complete(point.tensions, point.states)
            objective = float(instance.program.evaluate(x, p)[0][0])
            if np.isfinite(objective):
                taken.append(point)
                objectives.append(objective)
    order = np.argsort(objectives, kind="stable")
    return Samples(problem, count, [taken[i] for i in order], np.array(objectives)[order])


def _equilibria(instance: ProgramInstance) -> tuple[list[Equilibrium], int]:
    """Return the sampled equilibria, and the number of shapes that were tried."""
    loaded = is_coupled(instance.arm, instance.scene)
    if loaded and instance.forward.loads_first:
        points = instance.forward.solve_along(spread(instance.problem, _LINES))
        return points, len(points)
    tensions = spread(instance.problem, _LOADED if loaded else _SAMPLES)
    ends = _points(instance, tensions)
    return [end for end in ends if isinstance(end, Equilibrium)], len(tensions)


def _points(
    instance: ProgramInstance, tensions: Array, near: Sequence[Equilibrium | None] = ()
) -> Iterator[object]:
    """Yield the equilibrium under each of the tensions (m, n_tendons), or an error."""
    for k in range(0, len(tensions), _AT_ONCE):
        check_time()
        report("sampled shapes", k, len(tensions))
        some = slice(k, k + _AT_ONCE)
        yield from instance.forward.many(tensions[some], near[some])


def fitted(problem: PlanningProblem, tensions: Array) -> tuple[Array, Array]:
    """Return tensions (m, n_tendons) moved until the targets are met, and the misses left (m,).

    Each step is the smallest change of the tensions, so that the shapes stay near the shapes under
    the given tensions: Levenberg and Marquardt's method within the limits of each tendon.
    """
    instance = ProgramInstance(problem, problem.coarse("exact"))
    limits, unit = problem.allowed, instance.unit
    low, high = np.array(limits.lower) / unit, np.minimum(np.array(limits.upper) / unit, _FAR)
    fits = [_Fit(instance, point) for point in _points(instance, tensions)]
    for _ in range(_STEPS):
        going = [fit for fit in fits if fit.is_going]
        if not going:
            break
        trials = [fit.trial(low, high) for fit in going]
        points = _points(instance, np.array(trials) * unit, [fit.point for fit in going])
        for fit, point in zip(going, points, strict=True):
            fit.accept(point)
    kept = [fit for fit in fits if np.isfinite(fit.miss)]
    found = np.array([fit.point.tensions for fit in kept]).reshape(-1, problem.arm.n_tendons)
    return found, np.array([fit.miss for fit in kept])


class _Fit:
    """An arm on its way to the targets.

    Attributes
    ----------
    point : Equilibrium
        Equilibrium of the arm.
    miss : float
        Norm of the weighted residuals; infinite without an equilibrium.
    is_going : bool
        Whether the last steps reduced the miss.
    """

    def __init__(self, instance: ProgramInstance, point: object) -> None:
        self._instance = instance
        self._damping = _DAMPING
        self.miss = np.inf
        self.is_going = True
        self.accept(point)
        self.is_going = np.isfinite(self.miss)

    def accept(self, point: object) -> None:
        """Take a step that reduces the miss; otherwise increase the damping."""
        before = self.miss
        if isinstance(point, Equilibrium):
            with suppress(OctoplanError, np.linalg.LinAlgError):
                residuals, jacobian = _residuals(self._instance, point)
                miss = float(np.linalg.norm(residuals))
                if miss < before:
                    self.point = point
                    self.miss = miss
                    self._residuals = residuals
                    self._jacobian = jacobian
        if self.miss < before:
            self._damping *= 0.1
            self.is_going = _MET < self.miss < (1 - _FALL) * before
        else:
            self._damping *= 10.0
            self.is_going = self._damping <= _STIFF

    def trial(self, low: Array, high: Array) -> Array:
        """Return the tensions of the next step (n_tendons,), in units of the program."""
        z = self.point.tensions / self._instance.unit
        n, weight = z.size, np.sqrt(self._damping)
        step = lsq_linear(
            np.vstack([self._jacobian, weight * np.eye(n)]),
            -np.append(self._residuals, np.zeros(n)),
            (np.minimum(low - z, -_TINY), np.maximum(high - z, _TINY)),
            "bvls",
        ).x
        return np.asarray(np.clip(z + step, low, high))


def _residuals(instance: ProgramInstance, point: Equilibrium) -> tuple[Array, Array]:
    """Return weighted residuals of the targets (k,), and derivatives (k, n) by scaled tensions."""
    program, x = instance.program, instance.complete(point.tensions, point.states)
    _, _, g, J = instance.program.evaluate(x, instance.parameters())
    at, n = program.states, point.tensions.size
    by_states = point.by_tensions * instance.unit / instance.scale[at][:, None]
    rows = np.isin(program.row_kinds, (EQUALITY, INEQUALITY))
    J = J.tocsr()[rows]
    jacobian = J[:, :n].toarray() + J[:, at] @ by_states
    weights = np.ones(len(jacobian))
    terms = instance.target_set.terms
    weights[: terms.equality_weights.size] = terms.equality_weights
    equal = program.row_kinds[rows] == EQUALITY
    residuals = np.where(equal, g[rows], np.minimum(g[rows], 0.0))
    jacobian[~equal & (residuals == 0)] = 0.0
    return weights * residuals, weights[:, None] * jacobian


def spread(problem: PlanningProblem, count: int) -> Array:
    """Return tensions (count, n_tendons) over the limits [N]; always the same.

    The first are corners of the box of tensions. One half of the others bends few sections at a
    time, by all angles. The other half has any tendons at any level.
    """
    limits, rng = problem.allowed, np.random.default_rng(0)
    box = Box.of(problem)
    corners = box.corners(count // 2, rng)
    n_bends = (count - len(corners)) // 2
    bends = BendCoordinates(problem.arm, problem.target_set.tendons, limits)
    levels = box.levels(count - len(corners) - n_bends, rng)
    return np.vstack([corners, bends.tensions(bends.draw(n_bends)), levels])


@dataclass(frozen=True, eq=False)
class Box:
    """The box of tensions that are sampled.

    Attributes
    ----------
    limits : TendonLimits
    least, most : (n_tendons,)
        The range of the levels above the lower limits [N].
    """

    limits: TendonLimits
    least: Array
    most: Array

    @classmethod
    def of(cls, problem: PlanningProblem) -> Box:
        """Return the box of a problem."""
        natural, lower = natural_tensions(problem.arm), np.array(problem.allowed.lower)
        most = np.minimum(np.array(problem.allowed.upper) - lower, _MOST * natural)
        return cls(problem.allowed, np.minimum(_LEAST * natural, most), most)

    def corners(self, count: int, rng: np.random.Generator) -> Array:
        """Return all corners if there are no more than `count`, otherwise some of them."""
        free = np.flatnonzero(self.most > 0)
        if 2**free.size <= count:
            pulls = np.arange(2**free.size)[:, None] >> np.arange(free.size) & 1 == 1
        else:
            pulls = rng.uniform(size=(count, free.size)) < rng.uniform(size=(count, 1))
        T = np.zeros((len(pulls), self.most.size))
        T[:, free] = pulls * self.most[free]
        return within_total(np.array(self.limits.lower) + T, self.limits)

    def levels(self, count: int, rng: np.random.Generator) -> Array:
        """Return tensions (count, n_tendons): any tendons pull, at levels as small as large."""
        shape = count, self.most.size
        ratio = np.divide(self.most, self.least, np.ones(self.most.size), where=self.least > 0)
        level = self.least * ratio ** rng.uniform(size=shape)
        even = rng.uniform(size=shape) * self.most
        T = np.where(rng.uniform(size=(count, 1)) < 0.5, level, even)
        pulls = rng.uniform(size=shape) < rng.uniform(0.1, 0.9, size=(count, 1))
        return within_total(np.array(self.limits.lower) + pulls * T, self.limits)
