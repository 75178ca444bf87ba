"""The rows of the speed table that are about planning, and the floors; see studies.speed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from itertools import islice

import numpy as np

from model import Arm, OctoplanError, settle
from model.forward import explicit_map, schemes_of
from model.paths import Array
from planner import Limits, Plan, Statement, plan
from planner.program.problem import build
from planner.solve.ipopt import solve
from planner.targets import TipPosition
from studies import draws
from studies.baselines import ScipyArm
from studies.speed_settle import PAPER, Row, counted, power
from studies.timing import Spread, repeated, seconds, timed
from studies.tip_targets import MAXIMUM, draw

_SCIPY_STARTS = 10
_FIRST = """
import time
begin = time.perf_counter()
from model import Arm, Scene
from model.effects import Extension
from planner import plan
from planner.targets import TipPosition
p = plan(Arm.from_paper("table-4"), TipPosition((0.20, 0.15, -0.20)), Scene(Extension()), 20.0)
assert p.certificate.passed
print(time.perf_counter() - begin)
"""


def planned(
    arm: Arm, point: Array, upper: float | Array = MAXIMUM, near: Plan | None = None
) -> Plan:
    """Return the plan of a tip position, with its certificate."""
    found = plan(arm, TipPosition(tuple(point)), PAPER, upper, near=near)
    _ = found.certificate
    return found


def cold_rows(plans: int, rng: np.random.Generator) -> list[Row]:
    """Return cold, certified plans against SLSQP from random starts until one leads there."""
    arm = Arm.from_paper("table-4")
    scipy, found, ours, theirs = ScipyArm(arm), [], [], []
    points = [draw(arm, PAPER, rng, i % 3) for i in range(plans)]
    planned(arm, points[0])
    for point in points:
        starts = rng.uniform(size=(_SCIPY_STARTS, 12)) * np.repeat([0.1, 0.5, 1.5], 4)

        own, mine = timed(partial(planned, arm, point))
        other, (_, solved) = timed(partial(scipy.plan_tip_from, point, MAXIMUM, starts))
        ours.append(mine.reached)
        theirs.append(solved)
        found.append(other / own)
    shares = f"{np.mean(ours):.1%} and {np.mean(theirs):.1%}"
    return [
        Row("plan of a tip, certified", "SLSQP, differences, DOP853", "300", f"{Spread.of(found)}"),
        Row(f"  solved of {plans}, ours and SciPy's", "", "no fewer", shares),
    ]


def warm_row(points: int, rng: np.random.Generator) -> Row:
    """Return plans along a path of the tip, each near the one before, against cold ones."""
    arm = Arm.from_paper("table-4")
    path = tip_path(arm, points, rng)
    before, found = planned(arm, path[0]), []
    for point in path[1:]:
        cold = seconds(partial(planned, arm, point))
        warm, before = timed(partial(planned, arm, point, near=before))
        if not before.certificate.passed:
            raise RuntimeError(f"no plan for the tip {point.tolist()} of the path")
        found.append(cold / warm)
    return Row(f"plans along {points} points, warm", "cold plans", "5", f"{Spread.of(found)}")


def tip_path(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Return tips (count, 3) [m] of shapes on the way between two sets of tensions."""
    while True:
        begin, end = draws.rows(arm, rng, 2)
        shares = np.linspace(0, 1, count)[:, None]
        try:
            return np.array([settle(arm, T, PAPER).tip for T in begin + shares * (end - begin)])
        except OctoplanError:
            continue


def growth_of_plan(counts: Sequence[int], plans: int, rng: np.random.Generator) -> Row:
    """Return the power of the number of sections by which the time of a plan grows."""
    times = []
    for n in counts:
        arm = draws.many_sections(n)
        points = [settle(arm, T, PAPER).tip for T in draws.rows(arm, rng, plans)]
        upper = 3 * draws.most(arm)
        planned(arm, points[0], upper)
        taken = [seconds(partial(planned, arm, point, upper)) for point in points]
        times.append(float(np.median(taken)))
    return Row(f"plan, sections {counted(counts)}", "", "n^2", power(counts, times))


def first_row(repeats: int) -> Row:
    """Return the time of the first plan in a fresh process, import and build included."""
    command = [sys.executable, "-c", _FIRST]
    found = [
        float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        for _ in range(repeats)
    ]
    return Row("first plan in a process [s]", "", "1.5", f"{Spread.of(found)}")


def floor_rows(repeats: int, rng: np.random.Generator) -> list[Row]:
    """Return what one evaluation and one iteration of ipopt cost, below which nothing can be."""
    arm = Arm.from_paper("table-4")
    T = draws.tensions(arm, rng)
    forward = explicit_map(arm, PAPER, schemes_of(PAPER)[0], 2)
    target, limits = (TipPosition(tuple(settle(arm, T, PAPER).tip)),), Limits.of(arm, MAXIMUM)
    problem = build(arm, target, PAPER, Statement(refinement=2))
    p, bounds = problem.parameters(target, limits), problem.bounds(limits)
    x = problem.guess(T, limits, p)
    lam = np.zeros(problem.n_outer + problem.program.blocks.n_rows)
    evaluations = {
        "the forward map": lambda: forward.run(T),
        "constraints and their derivatives": lambda: problem.program.first(x, p),
        "second derivatives": lambda: problem.program.second(x, p, 1.0, lam),
    }
    rows = [
        Row(f"floor: {name} [us]", "", "", f"{_micro(repeated(work, repeats))}")
        for name, work in evaluations.items()
    ]
    iterations = []
    for start in islice(draws.endless(arm, rng), repeats):
        guess = problem.guess(start, limits, p)
        found = solve(problem, guess, p, bounds)
        taken = seconds(partial(solve, problem, guess, p, bounds))
        iterations.append(taken / max(found.iterations, 1))
    return [
        *rows,
        Row("floor: an iteration of ipopt [us]", "", "", f"{_micro(Spread.of(iterations))}"),
    ]


def _micro(spread: Spread) -> Spread:
    return Spread(1e6 * spread.low, 1e6 * spread.median, 1e6 * spread.high)
