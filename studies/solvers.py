"""What does multiple shooting solve that tensions alone do not?

Question: from the same initial guesses, how often does the planner's program (tensions, poses,
wrenches and strains as unknowns, ipopt) meet a tip, how often the program in the tensions alone,
the arm settled at each step, by SciPy's SLSQP and trust-constr; and how often is it the best?

Assumptions: tips of settled shapes (studies.draws), table 4, maxima of 20 N, the planner's
first initial guesses. The program in the tensions alone has exact derivatives
(octoplan.model.stiffness); meshes of both are those of the search, shapes of SciPy's are settled to
1e-4. Met is what is within 1e-3 of the length of the tip when it is settled; best is what takes no
more than 1 % more effort than the least of all. Times are the processor's, medians over all solves,
met or not.

Command: python -m studies.solvers [--targets 12] [--guesses 4] [--scenes paper silicone] [--seed 0]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import islice

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.paths import Array
from octoplan.model.stiffness import tip_jacobian
from octoplan.planner import Limits, NlpOptions
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import Problem
from octoplan.planner.solve.relaxation_stage import solve_from_guess
from octoplan.planner.solve.search import Search
from octoplan.planner.targets import TipPosition
from studies.draws import MAXIMUM, SCENES, shape
from studies.reporting import asked

_ROUGH, _MET, _BEST, _STEPS = 1e-4, 1e-3, 1.01, 100
Solver = Callable[[Search, Array, Array], Array | None]


def by_shooting(search: Search, tip: Array, guess: Array) -> Array | None:
    """Return the tensions that the planner's program leads to."""
    candidate = solve_from_guess(Problem(search.task, search.task.coarse("exact")), guess)
    return candidate.tensions if candidate.converged else None


def by_tensions(method: str) -> Solver:
    """Return the solver of the program in the tensions alone by a method of SciPy's minimize."""

    def solved(search: Search, tip: Array, guess: Array) -> Array | None:
        arm, scene = search.task.arm, search.task.scene

        def gap(T: Array) -> Array:
            return np.asarray(settle(arm, np.clip(T, 0, MAXIMUM), scene, _ROUGH).tip - tip)

        def slope(T: Array) -> Array:
            result = tip_jacobian(arm, np.clip(T, 0, MAXIMUM), scene, _ROUGH)
            return np.asarray(result[:3] / arm.length)

        held = NonlinearConstraint(lambda T: gap(T) / arm.length, 0.0, 0.0, jac=slope)
        optimum = minimize(
            lambda T: (T @ T / 2, T),
            guess,
            jac=True,
            bounds=Bounds(0.0, MAXIMUM),
            constraints=held,
            method=method,
            options={"maxiter": _STEPS},
        )
        return np.asarray(optimum.x)

    return solved


SOLVERS: dict[str, Solver] = {
    "multiple shooting, ipopt": by_shooting,
    "tensions alone, SLSQP": by_tensions("SLSQP"),
    "tensions alone, trust-constr": by_tensions("trust-constr"),
}


def attempt(solver: Solver, search: Search, tip: Array, guess: Array) -> tuple[float, float]:
    """Return the effort where a solver meets a tip, infinite where it does not, and seconds."""
    begin, arm, scene = time.process_time(), search.task.arm, search.task.scene
    try:
        T = solver(search, tip, guess)
        seconds = time.process_time() - begin
        if T is None:
            return np.inf, seconds
        T = np.clip(T, 0, MAXIMUM)
        met = np.linalg.norm(settle(arm, T, scene, _ROUGH).tip - tip) <= _MET * arm.length
        return (float(np.linalg.norm(T)) if met else np.inf), seconds
    except (OctoplanError, np.linalg.LinAlgError):
        return np.inf, time.process_time() - begin


def compare(name: str, scene: Scene, targets: int, guesses: int, seed: int) -> None:
    """Print a line for each solver."""
    arm, rng = Arm.from_paper("table-4"), np.random.default_rng(seed)
    rows: dict[str, list[tuple[bool, bool, float]]] = defaultdict(list)
    for i in range(targets):
        tip = shape(arm, scene, rng, i % 3).tip
        limits, target = Limits.of(arm, MAXIMUM), (TipPosition(tuple(tip)),)
        search = Search(PlanningProblem(arm, target, scene, limits, NlpOptions(), 1e-6))
        begins = list(islice(search.guesses(), guesses))
        entries = {
            name: [attempt(solver, search, tip, T) for T in begins]
            for name, solver in SOLVERS.items()
        }
        best = min(effort for value in entries.values() for effort, _ in value)
        for solver, value in entries.items():
            rows[solver] += [(e < np.inf, e <= _BEST * best < np.inf, s) for e, s in value]
    print(f"{name}, {targets} tips from {guesses} guesses each")
    for solver, value in rows.items():
        met, good, seconds = np.array(value, dtype=float).T
        message = f"{met.mean():>8.1%}{good.mean():>8.1%}{1e3 * np.median(seconds):>11.1f}"
        print(f"  {solver:<32}{message}", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its table."""
    args = asked(
        __doc__,
        argv,
        {
            "--targets": 12,
            "--guesses": 4,
            "--scenes": (["paper", "silicone"], {"choices": SCENES}),
            "--seed": 0,
        },
    )
    print(f"{'':<34}{'met':>8}{'best':>8}{'time [ms]':>11}")
    for name in args.scenes:
        compare(name, SCENES[name], args.targets, args.guesses, args.seed)


if __name__ == "__main__":
    main()
