"""Continuation in the target: what a start cannot be brought to directly, by way of what it is."""

from __future__ import annotations

import numpy as np

from model import Arm, Scene, settle
from model.effects import Extension
from planner import Limits, Statement
from planner.program.problem import TRACES, Problem
from planner.solve.continuation import continuation, continued_targets
from planner.solve.ipopt import Solution, solve
from planner.solve.task import Task
from planner.targets import Target, TipPosition
from tests.planner.cases import Array
from tests.planner.read_targets import drawn, off, pulls, read

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
MOST = 20.0
LIMITS = Limits.of(ARM, MOST)


def stated(target: Target, T: Array) -> tuple[Problem, Array, Array, tuple[Array, ...]]:
    """Return the coarse program of a target, unknowns for tensions, parameters and bounds."""
    task = Task(ARM, (target,), PAPER, LIMITS, Statement(), 1e-6)
    problem = task.problem(task.coarse("exact"))
    p = problem.parameters((target,), LIMITS, TRACES[0])
    return problem, problem.unknowns(T.ravel(), LIMITS, p), p, problem.bounds(LIMITS)


def test_it_leads_to_targets_that_a_direct_solve_misses_from_the_same_start() -> None:
    rng = np.random.default_rng(31)
    missed = led = 0
    for kind in ("pose", "fetch") * 5:
        target = read(kind, settle(ARM, drawn(rng, ARM, PAPER), PAPER, 1e-10))
        problem, x, p, bounds = stated(target, pulls(rng))
        if solve(problem, x, p, bounds).met:
            continue
        missed += 1
        solution = continued_targets(problem, x, p, bounds)
        if solution is not None:
            led += 1
            T = problem.tensions(solution.x, LIMITS)
            assert off(settle(ARM, T, PAPER, 1e-8), target, kind) < 0.03  # the coarse mesh's error
    assert missed >= 3
    assert led >= missed / 4


def test_the_way_to_what_is_out_of_reach_ends() -> None:
    far = TipPosition((1.2 * ARM.length, 0.0, 0.0))
    problem, x, p, bounds = stated(far, np.full(12, 0.1))
    assert continued_targets(problem, x, p, bounds) is None


def test_a_start_without_a_shape_leads_nowhere() -> None:
    problem, x, p, bounds = stated(TipPosition((0.3, 0.1, 0.0)), np.full(12, 0.1))
    x[0] = np.nan
    assert continued_targets(problem, x, p, bounds) is None


def at_most(longest: float, end: float = 1.0) -> tuple[list[float], Solution | None]:
    """Walk where steps longer than `longest` fail, and all beyond `end`; return the shares met."""
    zero = np.zeros(1)
    shares = [0.0]

    def at(near: Solution, share: float) -> Solution | None:
        if share - near.f > longest or share > end:
            return None
        shares.append(share)
        return Solution(zero, zero, zero, share, zero, True, "", 0)

    return shares, continuation(Solution(zero, zero, zero, 0.0, zero, True, "", 0), at)


def test_steps_are_halved_until_they_succeed_and_grow_again() -> None:
    shares, found = at_most(0.3)
    assert found is not None and found.f == 1.0
    assert 4 <= len(shares) - 1 <= 8
    assert at_most(1.0)[0] == [0.0, 1.0]


def test_a_walk_ends_where_there_is_no_way_on() -> None:
    shares, found = at_most(0.3, end=0.7)
    assert found is None
    assert 0.68 < max(shares) <= 0.7
