"""Which solver for programs in the tensions alone?

Question: from the initial guesses of cold plans, which solver finds the optimum, and how soon?

Assumptions: targets of the planner's suite (studies.reachable) in the scenes without loads, table
4, maxima of 20 N, compiled kernels; each solve that the planner gives to a solver, with targets as
equality constraints, is given to all. Met is what satisfies the first-order conditions to 1e-5;
best is what is met within 0.1 % of the least effort that any of them meets from that guess. Times
are the processor's, as shifted geometric means (shift 1 ms) over all solves, met or not.

Command: python -m studies.solvers [--targets 30] [--seed 0]

Answer (12 targets, 59 solves, on a busy machine; Fatrop takes no derivatives but CasADi's own, so
that compiled kernels are no use to it):

                                           met    best  time [ms]
    planner.solve.sqp                    59.3%   59.3%        2.9
    planner.solve.sqp, else ipopt        89.8%   89.8%        8.3
    ipopt                                89.8%   86.4%       14.0
    sqpmethod, daqp, eigen-clip          52.5%   52.5%        2.1
    sqpmethod, daqp, eigen-reflect       54.2%   52.5%        2.8
    sqpmethod, daqp, regularize          28.8%   28.8%       10.1
    sqpmethod, piqp, eigen-clip          64.4%   62.7%        4.0
    sqpmethod, proxqp, eigen-clip        50.8%   50.8%        5.1
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np

from model import OctoplanError
from model.machine.buffered import Buffered
from model.paths import Array
from planner import plan
from planner.program.explicit import Explicit
from planner.program.problem import Bounds, Problem
from planner.solve import ipopt, multistart
from planner.solve.newton import optimality
from planner.solve.sqp import solve_quadratic
from studies.reachable import ARM, MAXIMUM, READ, SCENES, draw

_MET, _BEST, _SHIFT = 1e-5, 1e-3, 1e-3
_QUIET = {"print_header": False, "print_iteration": False, "print_status": False}
Point = tuple[Array, Array, Array]
Solver = Callable[["Case"], Point | None]


@dataclass(frozen=True, eq=False)
class Case:
    """A program with its numbers, and where to begin."""

    problem: Problem
    x: Array
    p: Array
    bounds: Bounds


def cases(targets: int, seed: int) -> list[Case]:
    """Return the solves of the cold plans for so many targets."""
    found: list[Case] = []

    def kept(problem: Problem, x: Array, p: Array, bounds: Bounds, *more: Any) -> Any:
        if isinstance(problem.program, Explicit) and problem.statement.mode == "exact":
            found.append(Case(problem, x.copy(), p, bounds))
        return solve_quadratic(problem, x, p, bounds, *more)

    with patch.object(multistart, "solve_quadratic", kept):
        for number in range(targets):
            rng = np.random.default_rng([seed, number])
            scene = SCENES[("bare", "extension")[number % 2]][1]
            _, target = draw(rng, list(READ)[number % len(READ)], scene)
            plan(ARM, target, scene, MAXIMUM, compile=True)
    return found


def by_ipopt(case: Case) -> Point | None:
    """Solve by ipopt."""
    found = ipopt.solve(case.problem, case.x, case.p, case.bounds)
    return found.x, found.lam_x, found.lam_g


def by_sqp(case: Case) -> Point | None:
    """Solve by the planner's own sequential quadratic programming."""
    found = solve_quadratic(case.problem, case.x, case.p, case.bounds)
    return None if found is None else (found.x, found.lam_x, found.lam_g)


def by_both(case: Case) -> Point | None:
    """Solve as the planner does: by its own method, and by ipopt where that meets nothing."""
    found = solve_quadratic(case.problem, case.x, case.p, case.bounds)
    if found is None or not found.met:
        return by_ipopt(case)
    return found.x, found.lam_x, found.lam_g


Build = Callable[[Explicit], Buffered]


def by_casadi(built: dict[Explicit, Buffered], build: Build, case: Case) -> Point:
    """Solve by one of CasADi's own methods."""
    program = case.problem.program
    assert isinstance(program, Explicit)
    if program not in built:
        built[program] = build(program)
    lam = np.zeros(case.bounds[0].size), np.zeros(case.bounds[2].size)
    x, _, _, lam_x, lam_g, _ = (
        v.ravel() for v in built[program](case.x, case.p, *case.bounds, *lam)
    )
    return x, lam_x, lam_g


def _sqpmethod(quadratic: str, convex: str, program: Explicit) -> Buffered:
    of = program.symbols
    x, p = of.x, of.p
    first = ["f", "grad:f:x", "g", "jac:g:x"]
    values = [of.f, of.gradient, of.g, of.jacobian]
    given = ["x", "p", "lam:f", "lam:g"]
    hessian = ca.Function(
        "nlp_hess_l", [x, p, of.sigma, of.lam], [of.hessian], given, ["hess:gamma:x:x"]
    )
    options = {
        "qpsol": quadratic,
        "qpsol_options": {"error_on_fail": False},
        "convexify_strategy": convex,
        "convexify_margin": 1e-3,
        "elastic_mode": True,
        "max_iter": 60,
        "tol_pr": 1e-8,
        "tol_du": 1e-7,
        "jac_fg": ca.Function("nlp_jac_fg", [x, p], values, ["x", "p"], first),
        "hess_lag": hessian,
        "error_on_fail": False,
        "print_time": False,
        "show_eval_warnings": False,
        "no_nlp_grad": True,
        "calc_lam_p": False,
        **_QUIET,
    }
    return Buffered(ca.nlpsol("s", "sqpmethod", {"x": x, "p": p, "f": of.f, "g": of.g}, options))


def solvers() -> dict[str, Solver]:
    """Return the solvers by name."""
    found: dict[str, Solver] = {
        "planner.solve.sqp": by_sqp,
        "planner.solve.sqp, else ipopt": by_both,
        "ipopt": by_ipopt,
    }
    for quadratic, convex in (
        ("daqp", "eigen-clip"),
        ("daqp", "eigen-reflect"),
        ("daqp", "regularize"),
        ("piqp", "eigen-clip"),
        ("proxqp", "eigen-clip"),
    ):
        build = partial(_sqpmethod, quadratic, convex)
        found[f"sqpmethod, {quadratic}, {convex}"] = partial(by_casadi, {}, build)
    return found


def effort(case: Case, point: Point | None) -> float:
    """Return the objective where a solver ended, infinite where that is no optimum."""
    if point is None or not np.all(np.isfinite(point[0])):
        return np.inf
    x, lam_x, lam_g = point
    worst = optimality(case.problem, x, case.p, lam_x, lam_g, case.bounds).worst
    return case.problem.condensed.first(x, case.p).f if worst <= _MET else np.inf


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    asked, table = cases(args.targets, args.seed), {}
    for name, solver in solvers().items():
        for case in asked:  # what is built is not timed
            _tried(solver, case)
        table[name] = [_timed(solver, case) for case in asked]
    ends = {
        name: np.array([effort(case, run[1]) for case, run in zip(asked, runs, strict=True)])
        for name, runs in table.items()
    }
    best = np.min(list(ends.values()), axis=0)
    print(f"{len(asked)} solves\n{'':<34}{'met':>8}{'best':>8}{'time [ms]':>11}")
    for name, runs in table.items():
        met, seconds = np.isfinite(ends[name]), np.array([run[0] for run in runs])
        good = met & (ends[name] <= (1 + _BEST) * best)
        mean = np.exp(np.mean(np.log(seconds + _SHIFT))) - _SHIFT
        print(f"{name:<34}{met.mean():>8.1%}{good.mean():>8.1%}{1e3 * mean:>11.2f}")


def _timed(solver: Solver, case: Case) -> tuple[float, Point | None]:
    begin = time.process_time()
    found = _tried(solver, case)
    return time.process_time() - begin, found


def _tried(solver: Solver, case: Case) -> Point | None:
    try:
        return solver(case)
    except (OctoplanError, RuntimeError):
        return None


if __name__ == "__main__":
    main()
