"""Solve nonlinear programs by ipopt: options, derivatives, return statuses.

No other module mentions ipopt's options or return statuses.

CasADi's solvers regard exceptions in Python as failed evaluations. A callback therefore stops the
solver at the next iteration after Ctrl-C or at a time limit. The solver writes to the standard
output, which goes to the logger at level DEBUG.
"""

from __future__ import annotations

import io
import logging
import signal
import threading
from collections.abc import Iterator, Set
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.planning_problem import Mode
from octoplan.planner.program import Nlp, Program
from octoplan.planner.program_instance import Bounds, ProgramInstance
from octoplan.planner.solution import NlpSolution, SolverResult

LOG = logging.getLogger(__name__)
# Held by the thread whose solver writes to the standard output, which all threads share.
_OUTPUT_LOCK = threading.RLock()
# Factor of the objective in ipopt [-]. An effort is about 1e-2 at an optimum; with this factor the
# objective weighs as much as the barrier.
OBJECTIVE_SCALE = 1e3
# epsilon of relaxed target equalities, see octoplan.planner.program: the residual of a row is
# epsilon^2 times the change of the multiplier during the solve. In a search the change is the
# multiplier itself, and the residual is small; in a warm start the residual is a rounding error.
RELAXATION = 3e-5
# epsilon for optima that are polished, and for targets that have to be met exactly although there
# are more equalities than tensions (a backbone of the arm's own shape): residuals remain below the
# tolerance also along changes of the tensions that hardly change the shape.
POLISH_RELAXATION = 1e-6
# Largest residual of a target equality at which a relaxed program counts as converged [-].
EQUALITY_TOL = 1e-6
Options = dict[str, Any]
# Options of all solves. Programs are scaled already, and the matrices are banded.
_COMMON: Options = {
    "sb": "yes",
    "tol": 1e-8,
    "constr_viol_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "obj_scaling_factor": OBJECTIVE_SCALE,
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "mumps_pivot_order": 0,
}
# Options of a solve from a guess. max_iter is small, because another guess costs less than a long
# solve.
COLD: Options = {"max_iter": 60, "mu_init": 0.1, "bound_push": 5e-3, "bound_frac": 5e-3}
# Options of solves whose results are polished later. A barrier parameter that follows the iterates
# saves a quarter of the iterations.
_ROUGH: Options = {"mu_strategy": "adaptive", "tol": 1e-6, "constr_viol_tol": 1e-6}
# Options of several programs side by side, for which no other guess is cheaper.
SIDE_BY_SIDE: Options = COLD | _ROUGH | {"tol": 1e-7, "max_iter": 300}
# Options of a solve from the solution and the multipliers of a similar program.
WARM: Options = {
    "mu_init": 1e-6,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
    "tol": 1e-11,
    "constr_viol_tol": 1e-11,
    "acceptable_tol": 1e-8,
    "acceptable_constr_viol_tol": 1e-9,
    "acceptable_iter": 4,
    "max_iter": 40,
}
# Purposes of a solve: from a guess; from a guess, with target equalities to more digits; from the
# optimum for another target; from the optimum of nearly the same program; to the last digits.
Purpose = Literal["search", "meet", "follow", "near", "polish"]
# An objective that outweighs the barrier saves a sixth of the iterations. theta_max_fact limits the
# violation of equilibrium to ten times that of the guess.
_SEARCH = COLD | _ROUGH | {"obj_scaling_factor": 30 * OBJECTIVE_SCALE, "theta_max_fact": 10.0}
_EXACT: dict[Purpose, Options] = {
    "search": _SEARCH,
    "meet": _SEARCH,
    # The optimum for another target may have other active bounds.
    "follow": WARM | _ROUGH | {"max_iter": 60},
    "near": WARM,
    # Active bounds are fixed, others are far: no barrier is left.
    "polish": WARM | {"mu_init": 1e-12},
}
# Least squares need more iterations and more digits. The minimum may be nearly zero, so that only
# the weighted effort remains, which has to outweigh the barrier.
_SMALL_SCALING: Options = {"obj_scaling_factor": 100 * OBJECTIVE_SCALE}
_SMALL: Options = _SMALL_SCALING | {"max_iter": 200}
_LEAST_SQUARES: dict[Purpose, Options] = {
    "search": COLD | _SMALL | {"mu_init": 1e-3},
    "near": WARM | _SMALL_SCALING,
    "polish": _EXACT["polish"] | _SMALL_SCALING,
}
# Targets out of reach have large misses: with the factor above, the misses would outweigh
# equilibrium, and searches under loads would seldom converge. Some backbones need 100 iterations.
_FAR: Options = {"obj_scaling_factor": 100.0, "mu_init": 0.1, "max_iter": 100}
_BY_MODE: dict[Mode, dict[Purpose, Options]] = {
    "exact": _EXACT,
    "closest": _LEAST_SQUARES,
    "nearest": _LEAST_SQUARES | {"search": COLD | _FAR},
}

# Return statuses that count as convergence.
_CONVERGED = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level"})
# The same for an optimum that is polished: feasible steps as small as rounding errors.
_TO_ROUNDING = frozenset({"Search_Direction_Becomes_Too_Small"})


class Watch(ca.Callback):
    """Stops the solver at the next iteration after Ctrl-C, or when the time limit is reached.

    Ctrl-C stops the main thread alone, as in Python.
    """

    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.interrupted = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return the number of quantities of an iterate."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return an empty pattern: the iterate is not used."""
        return ca.Sparsity(0, 0)

    def eval(self, arg: Any) -> list[ca.DM]:
        """Return whether to stop."""
        with suppress(OutOfTime):
            check_time()
            return [ca.DM(self.interrupted and _is_main())]
        return [ca.DM(1)]

    @contextmanager
    def defer_interrupt(self) -> Iterator[None]:
        """Defer Ctrl-C until the solver has stopped."""
        previous = signal.getsignal(signal.SIGINT)
        if not _is_main() or not callable(previous):
            yield
            return
        signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, previous)
        if self.interrupted:
            self.interrupted = False
            previous(signal.SIGINT, None)

    def _interrupt(self, *_: Any) -> None:
        self.interrupted = True


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


# The callback of all solvers.
WATCH = Watch()


@contextmanager
def logged_output() -> Iterator[None]:
    """Log the standard output at level DEBUG, of one thread at a time."""
    if not LOG.isEnabledFor(logging.DEBUG):
        yield
        return
    with _OUTPUT_LOCK, redirect_stdout(io.StringIO()) as output:
        yield
    LOG.debug(output.getvalue().strip())


def nlp_solver(nlp: Nlp, options: Options, is_logged: bool = False) -> BufferedFunction:
    """Return ipopt for a nonlinear program.

    The solver takes x0, p, lbx, ubx, lbg, ubg, lam_x0, lam_g0 and returns x, f, g, lam_x, lam_g,
    lam_p. Each thread has a memory; plain calls of a CasADi solver would share one memory.
    """
    functions = {"x": nlp.w, "p": nlp.p, "f": nlp.f, "g": nlp.g}
    common: Options = {
        "print_time": False,
        "show_eval_warnings": False,
        # The check would warn of more equations than unknowns, for example if a plane fixes an arm.
        "inputs_check": False,
        "calc_lam_p": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "iteration_callback": WATCH,
        **nlp_derivatives(nlp),
        "ipopt": _COMMON | options | {"print_level": 5 if is_logged else 0},
    }
    return BufferedFunction(ca.nlpsol("ipopt", "ipopt", functions, common))


def nlp_derivatives(nlp: Nlp) -> dict[str, ca.Function]:
    """Return the derivatives by the names that CasADi's nlpsol prescribes.

    nlpsol expects values beside the derivatives. ipopt evaluates values separately, so that empty
    matrices suffice.
    """
    at, names = [nlp.w, nlp.p], ["x", "p"]
    f, g = ca.MX(1, 1), ca.MX(nlp.lam.numel(), 1)
    gradient = ca.densify(nlp.gradient)
    return {
        "grad_f": ca.Function("nlp_grad_f", at, [f, gradient], names, ["f", "grad:f:x"]),
        "jac_g": ca.Function("nlp_jac_g", at, [g, nlp.jacobian], names, ["g", "jac:g:x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [*at, nlp.sigma, nlp.lam],
            [nlp.hessian],
            [*names, "lam:f", "lam:g"],
            ["triu:hess:gamma:x:x"],
        ),
    }


def relaxation(purpose: Purpose) -> float:
    """Return epsilon of the target equalities, see RELAXATION."""
    return POLISH_RELAXATION if purpose in ("meet", "polish") else RELAXATION


@lru_cache(maxsize=32)
def solver(
    program: Program, purpose: Purpose, mode: Mode, is_logged: bool = False
) -> BufferedFunction:
    """Return ipopt for a program, its mode and a purpose, built once.

    Unknowns are those of the program, then e (m,), parameters those of the program, then e_0 (m,).
    """
    return nlp_solver(program.relaxed(relaxation(purpose)), _BY_MODE[mode][purpose], is_logged)


def solve(
    instance: ProgramInstance,
    x: Array,
    p: Array,
    bounds: Bounds | None = None,
    multipliers: tuple[Array, Array] | None = None,
    purpose: Purpose = "search",
) -> NlpSolution:
    """Solve the program of a problem from unknowns x.

    Parameters
    ----------
    instance : ProgramInstance
    x, p : (n_x,), (n_p,)
        Unknowns and parameters.
    bounds : Bounds
        The bounds of the problem unless given.
    multipliers : (lam_x, lam_g)
        Multipliers for a warm start; the purpose is not a search then.
    purpose : str
    """
    lbx, ubx, lbg, ubg = bounds or instance.bounds
    equality_rows = instance.program.equality_rows
    n, none = x.size, np.zeros(equality_rows.size)
    lam_x, lam_g = multipliers or (np.zeros(n), np.zeros(lbg.size))
    epsilon = relaxation(purpose)
    e_0 = epsilon * lam_g[equality_rows]
    unbounded = np.full(none.size, np.inf)
    relaxed_bounds = np.append(lbx, -unbounded), np.append(ubx, unbounded), lbg, ubg
    result = run_solver(
        solver(instance.program, purpose, instance.options.mode, LOG.isEnabledFor(logging.DEBUG)),
        np.append(x, e_0),
        np.append(instance.parameters_at(x, p), e_0),
        relaxed_bounds,
        (np.append(lam_x, none), lam_g),
        _CONVERGED | _TO_ROUNDING if purpose == "polish" else _CONVERGED,
    )
    x, e = np.split(result.x, [n])
    residual = epsilon * float(np.abs(e - e_0).max(initial=0.0))
    return NlpSolution(
        x,
        result.lam_x[:n],
        result.lam_g,
        result.f - float(e @ e) / 2,
        result.converged and residual <= EQUALITY_TOL,
        result.iterations,
        instance=instance,
    )


def run_solver(
    run: BufferedFunction,
    x: Array,
    p: Array,
    bounds: Bounds,
    multipliers: tuple[Array, Array] | None = None,
    statuses: Set[str] = _CONVERGED,
) -> SolverResult:
    """Run a solver from unknowns x, and log the output.

    The result counts as converged if the return status is among `statuses` and all numbers are
    finite.
    """
    multipliers = multipliers or (np.zeros(bounds[0].size), np.zeros(bounds[2].size))
    with WATCH.defer_interrupt(), logged_output():
        x, f, _, lam_x, lam_g, _ = (value.ravel() for value in run(x, p, *bounds, *multipliers))
    status, count = run.stats()["return_status"], int(run.stats()["iter_count"])
    converged = status in statuses
    LOG.debug("%s after %d iterations", "converged" if converged else f"failed: {status}", count)
    result = SolverResult(x, lam_x, lam_g, float(f[0]), converged, count)
    return result if result.is_finite else replace(result, converged=False)
