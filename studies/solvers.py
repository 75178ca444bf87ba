"""Does multiple shooting meet more targets than an optimiser of the tensions alone?

Questions: The planner's program has tensions, poses, wrenches and strains as unknowns and is solved
with ipopt. The alternative has only the tensions as unknowns, evaluates `settle` at each step, and
is solved with SLSQP or trust-constr from SciPy. From the same initial guesses, how often does each
solver meet a tip target, and how often is its optimum the best?

Assumptions: Targets are tips of random equilibria (studies.draws) of the arm of table 4, tensions
up to 20 N, from the planner's first initial guesses. The program in the tensions alone has exact
derivatives (octoplan.model.stiffness). Ipopt uses a mesh with an error of about 1e-4, SciPy shapes
with this accuracy. A target is met if the tip of the equilibrium is within 1e-3 of the arm's
length. An optimum is the best if its effort exceeds the least effort of all solvers by at most 1 %.
Times are processor times, medians over all solves, including failed ones.

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
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solve.multistart import solve_from_guess
from octoplan.planner.solve.search import Search
from octoplan.planner.targets import TipPosition
from studies.draws import MAXIMUM, SCENES, shape
from studies.reporting import asked

# Accuracy of the shapes for SciPy, in lengths.
_ACCURACY = 1e-4
# Refinement of the mesh for ipopt, with about this accuracy.
_REFINEMENT = 2
# Largest distance of a met target, in lengths.
_MET = 1e-3
# Largest effort of the best optima, relative to the least.
_BEST = 1.01
# Largest number of iterations of SciPy's solvers.
_STEPS = 100
Solver = Callable[[Search, Array, Array], Array | None]


def by_shooting(search: Search, tip: Array, guess: Array) -> Array | None:
    """Return the solution of the planner's program (n_tendons,) [N], or None if not converged."""
    options = search.problem.coarse("exact").replace(refinement=_REFINEMENT)
    candidate = solve_from_guess(ProgramInstance(search.problem, options), guess)
    return candidate.tensions if candidate.converged else None


def by_tensions(method: str) -> Solver:
    """Return a solver of the program in the tensions alone, with a method of SciPy's minimize."""

    def solver(search: Search, tip: Array, guess: Array) -> Array | None:
        arm = search.problem.arm
        scene = search.problem.scene

        def gap(T: Array) -> Array:
            return np.asarray(settle(arm, np.clip(T, 0, MAXIMUM), scene, _ACCURACY).tip - tip)

        def slope(T: Array) -> Array:
            result = tip_jacobian(arm, np.clip(T, 0, MAXIMUM), scene, _ACCURACY)
            return np.asarray(result[:3] / arm.length)

        tip_constraint = NonlinearConstraint(lambda T: gap(T) / arm.length, 0.0, 0.0, jac=slope)
        optimum = minimize(
            lambda T: (T @ T / 2, T),
            guess,
            jac=True,
            bounds=Bounds(0.0, MAXIMUM),
            constraints=tip_constraint,
            method=method,
            options={"maxiter": _STEPS},
        )
        return np.asarray(optimum.x)

    return solver


SOLVERS: dict[str, Solver] = {
    "multiple shooting, ipopt": by_shooting,
    "tensions alone, SLSQP": by_tensions("SLSQP"),
    "tensions alone, trust-constr": by_tensions("trust-constr"),
}


def run_solver(solver: Solver, search: Search, tip: Array, guess: Array) -> tuple[float, float]:
    """Run a solver; return the effort [N], infinite if the tip is missed, and the time [s]."""
    arm = search.problem.arm
    scene = search.problem.scene
    begin = time.process_time()
    try:
        T = solver(search, tip, guess)
        seconds = time.process_time() - begin
        if T is None:
            return np.inf, seconds
        T = np.clip(T, 0, MAXIMUM)
        met = np.linalg.norm(settle(arm, T, scene, _ACCURACY).tip - tip) <= _MET * arm.length
        return (float(np.linalg.norm(T)) if met else np.inf), seconds
    except (OctoplanError, np.linalg.LinAlgError):
        return np.inf, time.process_time() - begin


def compare(name: str, scene: Scene, targets: int, guesses: int, seed: int) -> None:
    """Print one line for each solver."""
    arm = Arm.from_paper("table-4")
    rng = np.random.default_rng(seed)
    rows: dict[str, list[tuple[bool, bool, float]]] = defaultdict(list)
    for i in range(targets):
        tip = shape(arm, scene, rng, i % 3).tip
        limits = TendonLimits.of(arm, MAXIMUM)
        target = (TipPosition(tuple(tip)),)
        search = Search(PlanningProblem(arm, target, scene, limits, NlpOptions(), 1e-6))
        initial_guesses = list(islice(search.guesses(), guesses))
        entries = {
            name: [run_solver(solver, search, tip, T) for T in initial_guesses]
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
    """Print the table."""
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
