"""Work-precision of whole plans, the price of their statics, and of silicone by stages and meshes.

See studies.speed.accuracy.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from model import Arm, OctoplanError, Scene, settle
from model.effects import Buoyancy, ExactTendons, Extension, Weight
from model.forward import by_collocation
from model.mesh import REFINEMENTS
from model.paths import Array
from planner import plan
from planner.plots.work import Curve
from planner.program.limits import Limits
from planner.program.problem import build
from planner.program.statement import STAGES as PLANNED
from planner.program.statement import Statement
from planner.solve.ipopt import solve
from planner.targets import TipPosition
from studies import draws
from studies.baselines import ScipyArm, ScipySiliconeArm
from studies.speed.settle import PAPER
from studies.speed.settling_curves import KNOB, Measured, Size, chosen, tip_by
from studies.speed.timing import repeated, timed, while_budget
from studies.tip_targets import MAXIMUM, draw

ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
STARTS = (1, 2, 3, 5, 8, 14)
RTOLS = (1e-3, 1e-4, 1e-6, 1e-8)
STATICS = {
    "as printed": Scene.as_printed(),
    "paper": PAPER,
    "exact tendons": Scene(Extension(), ExactTendons()),
    "neo-Hookean": Scene.silicone(),
}
# What a way made of target i: the tensions, or None where it did not solve it.
Way = Callable[[int], Array | None]


@dataclass(frozen=True, eq=False)
class Attempts:
    """What one setting of a way took [s], and the tensions it led to, target by target."""

    seconds: list[float]
    found: list[Array | None]

    @classmethod
    def of(cls, way: Way, targets: int, size: Size) -> Attempts:
        """Return attempts, the targets in turn, by processor time; the first one builds."""
        way(0)
        turns = while_budget(targets, size.repeats, size.budget)
        rows = [timed(partial(way, k % targets), time.process_time) for k in turns]
        return cls([time for time, _ in rows], [T for _, T in rows])


def reachable(count: int, rng: np.random.Generator) -> list[Array]:
    """Return reachable tips (3,) [m] of the table 4 arm."""
    arm = Arm.from_paper("table-4")
    return [draw(arm, PAPER, rng, i % 3) for i in range(count)]


def planned(points: list[Array], accuracy: float, starts: int, i: int) -> Array | None:
    """Return the tensions of a plan, None where its certificate does not pass."""
    arm, target = Arm.from_paper("table-4"), TipPosition(tuple(points[i]))
    found = plan(arm, target, PAPER, MAXIMUM, accuracy=accuracy, starts=starts)
    return np.ravel(found.tensions) if found.certificate.passed else None


def slsqp(
    scipy: ScipyArm, points: list[Array], guesses: Array, rtol: float, i: int
) -> Array | None:
    """Return what SLSQP finds from one start, None where it gives up or misses by 1e-3 L."""
    settings = {"ftol": rtol, "rtol": rtol, "within": 1e-3}
    T, _, solved = scipy.plan_tip(points[i], MAXIMUM, guesses[i], **settings)
    return T if solved else None


def ways(
    points: list[Array], size: Size, rng: np.random.Generator
) -> dict[str, tuple[str, list[Way]]]:
    """Return (kind of curve, settings) of the ways to plan, by name."""
    scipy, few = ScipyArm(Arm.from_paper("table-4")), size.settings
    guesses = rng.uniform(size=(len(points), 12)) * np.repeat([0.1, 0.5, 1.5], 4)
    by_accuracy: list[Way] = [partial(planned, points, a, 14) for a in ACCURACIES[:few]]
    by_starts: list[Way] = [partial(planned, points, 1e-6, n) for n in STARTS[:few]]
    by_rtol: list[Way] = [partial(slsqp, scipy, points, guesses, r) for r in RTOLS[:few]]
    return {
        "plan, accuracy 1e-9 to 1e-2": ("choice", by_accuracy),
        "plan, 1 to 14 starts": ("own", by_starts),
        "SLSQP, one start, rtol 1e-8 to 1e-3": ("other", by_rtol),
    }


def plans(points: list[Array], size: Size, rng: np.random.Generator) -> tuple[list[Curve], ...]:
    """Return curves of the tip's distance from the target over L, and of effort above the best.

    The best is that of any way here or of 30 starts.
    """
    arm, n = Arm.from_paper("table-4"), len(points)
    measured = {
        name: (kind, [Attempts.of(way, n, size) for way in settings])
        for name, (kind, settings) in ways(points, size, rng).items()
    }
    many = [planned(points, 1e-6, 30, i) for i in range(n)]
    efforts = np.array([np.inf if T is None else np.linalg.norm(T) for T in many])
    for _, settings in measured.values():
        for attempts in settings:
            for k, T in enumerate(attempts.found):
                if T is not None and _gap(arm, T, points[k % n]) < 1e-6:
                    efforts[k % n] = min(efforts[k % n], np.linalg.norm(T))

    def gap(T: Array, i: int) -> float:
        return _gap(arm, T, points[i])

    def excess(T: Array, i: int) -> float:
        return max(float(np.linalg.norm(T) / efforts[i]) - 1, 0.0)

    return tuple(
        [_curve(name, kind, rows, error, n) for name, (kind, rows) in measured.items()]
        for error in (gap, excess)
    )


def _gap(arm: Arm, T: Array, point: Array) -> float:
    return math.dist(settle(arm, T, PAPER, 1e-11).tip, point) / arm.length


def _curve(
    name: str,
    kind: str,
    settings: Sequence[Attempts],
    error: Callable[[Array, int], float],
    targets: int,
) -> Curve:
    """Return the curve of a way; crosses where not even half of the targets were solved."""
    costs, errors, failed = [], [], []
    for attempts in settings:
        solved = [(k % targets, T) for k, T in enumerate(attempts.found) if T is not None]
        cost = np.percentile(attempts.seconds, [25, 50, 75])
        if len(solved) < len(attempts.found) / 2:
            failed.append(cost[1])
            continue
        costs.append(cost)
        errors.append(np.percentile([error(T, i) for i, T in solved], [25, 50, 75]))
    rows = np.array(costs).reshape(-1, 3), np.array(errors).reshape(-1, 3)
    return Curve(name, *rows, np.array(failed), kind)


def statics(size: Size, rng: np.random.Generator) -> list[Curve]:
    """Return how far tips are from those of the neo-Hookean body, over L, and times [ms].

    Of tensions that all statics settle under.
    """
    arm, rows = Arm.from_paper("table-4"), []
    sets = draws.endless(arm, rng)
    while len(rows) < size.cases:
        T = next(sets)
        try:
            rows.append((T, [settle(arm, T, scene).tip for scene in STATICS.values()]))
        except OctoplanError:
            continue
    tips = np.array([found for _, found in rows])
    # The last is the one to trust; it is off by what settle's accuracy leaves.
    off = np.maximum(np.linalg.norm(tips - tips[:, -1:], axis=2) / arm.length, 1e-6)
    curves = []
    for i, (name, scene) in enumerate(STATICS.items()):
        spread = repeated(partial(settle, arm, rows[0][0], scene), size.repeats)
        cost = 1e3 * np.array([[spread.low, spread.median, spread.high]])
        curves.append(Curve(name, cost, np.percentile(off[:, i], [25, 50, 75])[None]))
    return curves


STAGES = (1, 2, 3, 4)
SCENES = {
    "silicone": (Scene.silicone(), 0.0, 0.0),
    "silicone in water": (Scene.silicone(Weight(), Buoyancy(1000.0)), -9.81, 1000.0),
}
# Of SciPy, each of whose settles takes seconds.
_TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8)
# A plan begins where its tensions are so much of those that are wanted; finer meshes cost minutes.
_BEGINS, _FINEST, _ROUNDING = 0.8, 32, 3e-10


def stages_name(stages: int) -> str:
    """Return what a curve of so many stages is called."""
    return f"collocation, m = {stages}"


def settling_in_silicone(which: str, size: Size, rng: np.random.Generator) -> list[Measured]:
    """Return every number of stages on every mesh, the knob's choices, and SciPy."""
    (scene, gravity, fluid), arm = SCENES[which], Arm.from_paper("table-4")
    T = draws.rows(arm, rng, size.cases)
    true = [settle(arm, row, scene, 1e-11).tip for row in T]

    def off(i: int, tip: Array) -> float:
        return math.dist(tip, true[i]) / arm.length

    curves = []
    for m in STAGES:

        def work_on(refinement: int, m: int = m) -> Callable[[int], Array]:
            return partial(tip_by, by_collocation(arm, scene, m, refinement, loaded=True), T)

        curves.append(Measured.over_meshes(stages_name(m), work_on, off, size))
    scipy, few = ScipySiliconeArm(arm, np.zeros(3), np.array([0, 0, gravity]), fluid), []
    for way, method in (("SciPy shooting", scipy.shoot), ("SciPy solve_bvp", scipy.collocate)):
        curve = Measured(way, "other")
        for rtol in _TOLERANCES[: size.settings]:
            curve.add(lambda i, w=method, r=rtol: w(T[i], r), off, size)
        few.append(curve)
    return [*curves, chosen(arm, scene, T, off, size), *few]


def planning_in_silicone(which: str, size: Size, rng: np.random.Generator) -> list[Measured]:
    """Return solves of a tip's plan from one start by stages and mesh, and what `plan` chooses."""
    scene, arm = SCENES[which][0], Arm.from_paper("table-4")
    T = draws.rows(arm, rng, size.cases)
    points = [settle(arm, row, scene, 1e-9).tip for row in T]

    def off(i: int, tensions: Array) -> float:
        return math.dist(settle(arm, tensions, scene, 1e-11).tip, points[i]) / arm.length

    coarser = replace(size, finest=min(size.finest, _FINEST))

    def work_on(refinement: int) -> Callable[[int], Array]:
        return partial(_solved, arm, scene, refinement, T, points)

    curve = Measured.over_meshes(stages_name(PLANNED), work_on, off, coarser)
    choice = Measured("plan's choice, certified", "choice")
    for accuracy in KNOB[1 : size.settings]:
        choice.add(lambda i, a=accuracy: _planned(arm, scene, points[i], a), off, size)
    return [curve, choice]


def _solved(
    arm: Arm, scene: Scene, refinement: int, T: Array, points: list[Array], i: int
) -> Array:
    """Return the tensions of least effort on one mesh near those that the target was drawn with."""
    targets, limits = (TipPosition(tuple(points[i])),), Limits.of(arm, MAXIMUM)
    problem = build(arm, targets, scene, Statement(refinement=refinement))
    p = problem.parameters(targets, limits)
    x = problem.guess(_BEGINS * np.ravel(T[i]), limits, p)
    found = solve(problem, x, p, problem.bounds(limits))
    if not found.met:
        raise RuntimeError("no optimum near this start")
    return problem.tensions(found.x, limits)


def _planned(arm: Arm, scene: Scene, point: Array, accuracy: float) -> Array:
    found = plan(arm, TipPosition(tuple(point)), scene, MAXIMUM, accuracy=accuracy)
    if not found.reached:
        raise RuntimeError(found.outcome)
    return np.ravel(found.tensions)


def orders(curves: list[Measured]) -> list[str]:
    """Return the order of each number of stages, measured between meshes that tell, as text."""
    told = []
    for curve in (curve for curve in curves if curve.name.startswith("collocation")):
        errors = np.array([row[1] for row in curve.errors])
        pairs = zip(errors[:-1], errors[1:], REFINEMENTS, REFINEMENTS[1:], strict=False)
        found = [
            np.log(a / b) / np.log(fine / coarse)
            for a, b, coarse, fine in pairs
            if 1e-2 > a > b > _ROUNDING
        ]
        if found:
            told.append(f"{curve.name}: order {np.median(found):.1f}")
    return told
