"""Enforce a stability margin: solve an optimum again with the least stable mode as unknowns."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.nlp_solution import NlpSolution
from octoplan.planner.problem import SEARCH_WEIGHT
from octoplan.planner.solve.ipopt import solve
from octoplan.planner.solve.refine import COARSE_RTOL, CORRECTIONS
from octoplan.planner.solve.stable_descent import descend


def enforce_margin(optimum: NlpSolution, bound: float) -> NlpSolution | None:
    """Return an optimum near an unstable optimum with at least the stability `bound`, or None.

    One mode is constrained. If another mode is then below the bound, that mode is constrained next.
    If loads act before tensions, a descent constrains the least stable mode of each shape.
    """
    near = optimum
    tolerance = COARSE_RTOL * bound
    if optimum.problem.forward.loads_first:
        problem = optimum.problem.replace(modes=1, floor=bound)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            near = descend(problem, problem.linearised(optimum.x))
            return near if near.converged and problem.is_stable(near.x, bound - tolerance) else None
        return None
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(CORRECTIONS):
            problem = near.problem.replace(modes=1, floor=bound)
            states = near.problem.linearised(near.x).states
            x = problem.complete(near.tensions, states)
            near = solve(problem, x, problem.parameters(SEARCH_WEIGHT))
            check_time()
            if not near.converged:
                break
            if problem.is_stable(near.x, bound - tolerance):
                return near
    return None
