"""Descent from a stable shape to an optimum with the required stability.

The least stable mode is an unknown, held to a margin. Far from the start another mode may become
the least stable one, and solves from unstable shapes seldom converge. Each solve is therefore
confined to a box of tensions and base joints around the last stable shape. The box grows after a
step to a better stable shape, and shrinks after any other step.

Source: Conn, Gould, Toint, "Trust-region methods", SIAM (2000).
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.nlp_solution import NlpSolution
from octoplan.planner.problem import SEARCH_WEIGHT, Problem
from octoplan.planner.solve.ipopt import solve

# Half the width of the first box, in units of the tensions [-].
_FIRST_WIDTH = 0.15
# Half the width of the smallest box [-].
_LEAST_WIDTH = 5e-3
# Factor of the width after a step to a better stable shape [-].
_GROWTH = 2.0
# Factor of the width after any other step [-].
_CUT = 0.25
# Largest number of steps.
_STEPS = 14
# Relative decrease of the objective below which the descent ends [-].
_END_RTOL = 1e-2
# Relative error of the stability on the coarse mesh [-].
_STABILITY_RTOL = 1e-3


def descend(problem: Problem, start: Equilibrium) -> NlpSolution | None:
    """Return the optimum that a descent from a stable shape leads to; None if no step succeeds.

    The unknowns of `problem` include a mode; `start` is an equilibrium on the mesh of the problem.
    """
    best: NlpSolution | None = None
    objective = np.inf
    width = _FIRST_WIDTH
    boxed = problem.controls
    margin = (1 - _STABILITY_RTOL) * problem.options.stability_bound
    lbx, ubx, lbg, ubg = problem.bounds
    p = problem.parameters(SEARCH_WEIGHT)
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(_STEPS):
            check_time()
            x = problem.complete(start.tensions, start.states)
            low = lbx.copy()
            high = ubx.copy()
            low[boxed] = np.maximum(lbx[boxed], x[boxed] - width)
            high[boxed] = np.minimum(ubx[boxed], x[boxed] + width)
            trial = solve(problem, x, p, (low, high, lbg, ubg), purpose="step")
            is_better = trial.converged and trial.f < objective
            if is_better and problem.is_stable(trial.x, margin):
                gain = objective - trial.f
                is_inside = bool(np.abs(trial.x - x)[boxed].max() < 0.99 * width)
                best = trial
                objective = trial.f
                start = problem.linearised(trial.x)
                if is_inside or gain < _END_RTOL * objective:
                    break
                width *= _GROWTH
            else:
                width *= _CUT
                if width < _LEAST_WIDTH:
                    break
    return best
