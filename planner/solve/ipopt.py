"""The only file that knows ipopt: its options, its words, and what they mean.

What ipopt has to say goes to the logger of this module, at level DEBUG, and nowhere else. Ctrl-C
and time limits reach it by a callback, as it takes exceptions for failed evaluations.
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
from octoplan.planner.nlp_options import Mode
from octoplan.planner.program.problem import KKT_TOLERANCE, Bounds, Candidate, Problem, SolverResult
from octoplan.planner.program.program import Program


class Watch(ca.Callback):
    """Stops ipopt at the next iteration once Ctrl-C was pressed or the time limit is reached.

    Ctrl-C is for the main thread alone, as it is in Python; others go on.
    """

    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.interrupted = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return how many things an iteration is made of."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return that none of them is wanted."""
        return ca.Sparsity(0, 0)

    def eval(self, arg: Any) -> list[ca.DM]:
        """Return whether to stop."""
        with suppress(OutOfTime):
            check_time()
            return [ca.DM(self.interrupted and _is_main())]
        return [ca.DM(1)]

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold Ctrl-C back until the solver has stopped, and hand it on then."""
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


LOG = logging.getLogger(__name__)
# Held by the thread whose solver writes to the standard output, which all threads have in common.
_TALKING = threading.RLock()

# Efforts are about 1e-2 in the program's units: so magnified they weigh as much as the barrier.
MAGNIFIED = 1e3
# Equalities r = 0 are stated as r = RELAXED (t - c), t^2 / 2 added to the objective: t is RELAXED
# times the multiplier then, which is of any size where equalities all but depend on each other. So
# r is RELAXED^2 times what the multiplier differs by from that of the start, of which c is made: 0
# in a search, so that r is small; warm it is a rounding error. Source: Rockafellar, "Augmented
# Lagrangians and applications of the proximal point algorithm", Math. Oper. Res. 1 (1976).
RELAXED = 3e-5
# The same for optima that are polished, and for targets that are to be met exactly although the
# tensions can meet fewer equalities than there are (a backbone of the arm's own shape): residuals
# stay below the tolerance along changes of the tensions that the shape hardly shows.
POLISHED = 1e-6
Options = dict[str, Any]
_QUIET: Options = {
    "sb": "yes",
    "tol": 1e-8,
    "constr_viol_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "obj_scaling_factor": MAGNIFIED,
    # Matrices are scaled already, and of a band.
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "mumps_pivot_order": 0,
}
# What takes longer is lost: another initial guess is cheaper.
COLD: Options = {"max_iter": 60, "mu_init": 0.1, "bound_push": 5e-3, "bound_frac": 5e-3}
# Optima are polished later. A barrier parameter that follows the iterates takes a quarter fewer of
# them.
_ROUGH: Options = {"mu_strategy": "adaptive", "tol": 1e-6, "constr_viol_tol": 1e-6}
# Of several programs side by side, where no other guess is cheaper.
TOGETHER: Options = COLD | _ROUGH | {"tol": 1e-7, "max_iter": 300}
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
Purpose = Literal["search", "meet", "follow", "near", "polish"]
_FOR: dict[Purpose, Options] = {
    # An objective that outweighs the barrier takes a sixth fewer iterations; steps that lead ten
    # times farther from equilibrium than the guess are cut.
    "search": COLD | _ROUGH | {"obj_scaling_factor": 30 * MAGNIFIED, "theta_max_fact": 10.0},
    # Targets that least squares all but meet.
    "meet": COLD | _ROUGH | {"obj_scaling_factor": 30 * MAGNIFIED, "theta_max_fact": 10.0},
    # From the optimum for another target, which may hold other bounds.
    "follow": WARM | _ROUGH | {"max_iter": 60},
    "near": WARM,
    # Bounds that hold are fixed, others are far: there is no barrier left to follow.
    "polish": WARM | {"mu_init": 1e-12},
}
# Least squares of what cannot be met take longer, to more digits, and there is no cheaper way. What
# they come to is small, and where they all but vanish only the weighted effort is left, which the
# barrier must not outweigh.
_SMALL: Options = {"obj_scaling_factor": 100 * MAGNIFIED, "max_iter": 200}
_LEAST: dict[Purpose, Options] = {
    "search": COLD | _SMALL | {"mu_init": 1e-3},
    "near": WARM | _SMALL,
    "polish": _FOR["polish"] | _SMALL,
}
# Some backbones take that many iterations. Targets out of reach are missed by much: magnified as
# above, least squares would outweigh equilibrium, and searches under loads seldom end.
_FAR: Options = {"obj_scaling_factor": 100.0, "mu_init": 0.1, "max_iter": 100}
_BY_MODE: dict[Mode, dict[Purpose, Options]] = {
    "exact": _FOR,
    "closest": _LEAST,
    "nearest": _LEAST | {"search": COLD | _FAR},
}


_WATCH = Watch()
# How it ends where it says that it is at an optimum; and where feasible steps are as small as
# rounding, which is all that is left to an optimum that is polished.
_MET = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level"})
_TO_ROUNDING = frozenset({"Search_Direction_Becomes_Too_Small"})


def nlp_solver(
    nlp: dict[str, ca.MX],
    derivatives: dict[str, ca.Function],
    purpose_options: Options,
    talks: bool = False,
) -> BufferedFunction:
    """Return ipopt for a nonlinear program in symbols, with its own derivatives, and options.

    It takes x0, p, lbx, ubx, lbg, ubg, lam_x0, lam_g0 and returns x, f, g, lam_x, lam_g, lam_p.
    Each thread solves in memory of its own: CasADi's plain call of a solver has one for all.
    """
    options: Options = {
        "print_time": False,
        "show_eval_warnings": False,
        # It would warn of more equations than unknowns, as where a plane holds an arm.
        "inputs_check": False,
        "calc_lam_p": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "iteration_callback": _WATCH,
        **derivatives,
        "ipopt": _QUIET | purpose_options | {"print_level": 5 if talks else 0},
    }
    return BufferedFunction(ca.nlpsol("ipopt", "ipopt", nlp, options))


def relaxed(purpose: Purpose) -> float:
    """Return by how much equalities may be missed, see RELAXED."""
    return POLISHED if purpose in ("meet", "polish") else RELAXED


@lru_cache(maxsize=32)
def solver(of: Program, purpose: Purpose, mode: Mode, talks: bool = False) -> BufferedFunction:
    """Return ipopt for a program of a mode and a purpose, built once.

    The equalities, its first m rows, may be missed by `relaxed(purpose)` (t - c); unknowns are
    those of the program, then t (m,), parameters those of the program, then c (m,).
    """
    n, m = of.size, of.n_equalities
    x, (_, p, sigma, lam) = ca.MX.sym("x", n + m), of.function.mx_in()
    p = ca.MX.sym("p", p.numel() + m)
    numbers, centre = ca.vertsplit(p, [0, p.numel() - m, p.numel()])
    f, gradient, g, jacobian, hessian = of.function.call([x[:n], numbers, sigma, lam], True, False)
    t, slack = x[n:], ca.DM(ca.Sparsity.diag(of.rows.size, m), relaxed(purpose))
    f, g = f + ca.sumsqr(t) / 2, g - slack @ (t - centre)
    first = ca.vertcat(gradient, t), ca.horzcat(jacobian, -slack)
    second = ca.diagcat(hessian, sigma * ca.DM.eye(m))
    nlp, derivatives = {"x": x, "p": p, "f": f, "g": g}, named((x, p, sigma, lam), *first, second)
    return nlp_solver(nlp, derivatives, _BY_MODE[mode][purpose], talks)


def named(
    symbols: tuple[ca.MX, ...], gradient: ca.MX, jacobian: ca.MX, hessian: ca.MX
) -> dict[str, ca.Function]:
    """Return derivatives by the names that nlpsol takes them by.

    Of unknowns, parameters, and weights of objective and constraints: the gradient of the
    objective, the Jacobian of the constraints, the upper half of the Lagrangian's Hessian. Values,
    which nlpsol lists with them, are left out: ipopt asks for these apart.
    """
    at, names = list(symbols[:2]), ["x", "p"]
    weights = ["lam:f", "lam:g"]
    result = ["triu:hess:gamma:x:x"]
    first, f, g = ca.densify(gradient), ca.MX(1, 1), ca.MX(symbols[3].numel(), 1)
    return {
        "grad_f": ca.Function("nlp_grad_f", at, [f, first], names, ["f", "grad:f:x"]),
        "jac_g": ca.Function("nlp_jac_g", at, [g, jacobian], names, ["g", "jac:g:x"]),
        "hess_lag": ca.Function("nlp_hess_l", list(symbols), [hessian], names + weights, result),
    }


def solve(
    problem: Problem,
    x: Array,
    p: Array,
    bounds: Bounds | None = None,
    multipliers: tuple[Array, Array] | None = None,
    purpose: Purpose = "search",
) -> Candidate:
    """Solve from x; warm from multipliers (lam_x, lam_g) where the purpose is not a search.

    Within the problem's bounds, unless others are given.
    """
    lbx, ubx, lbg, ubg = bounds or problem.bounds
    n, none = x.size, np.zeros(problem.program.n_equalities)
    lam_x, lam_g = multipliers or (np.zeros(n), np.zeros(lbg.size))
    slack = relaxed(purpose)
    centre = slack * lam_g[: none.size]
    begin = np.append(x, centre)
    limits = np.append(lbx, none - np.inf), np.append(ubx, none + np.inf), lbg, ubg
    mode, talks = problem.options.mode, LOG.isEnabledFor(logging.DEBUG)
    run = solver(problem.program, purpose, mode, talks)
    p = np.append(problem.with_mode(x, p), centre)
    ends = _MET | _TO_ROUNDING if purpose == "polish" else _MET
    end = solved(run, begin, p, limits, (np.append(lam_x, none), lam_g), ends)
    x, t = np.split(end.x, [n])
    missed = slack * float(np.abs(t - centre).max(initial=0.0))
    met = end.met and missed <= KKT_TOLERANCE
    f = end.f - float(t @ t) / 2
    return Candidate(x, end.lam_x[:n], end.lam_g, f, met, end.iterations, problem=problem)


def solved(
    run: BufferedFunction,
    x: Array,
    p: Array,
    bounds: Bounds,
    multipliers: tuple[Array, Array] | None = None,
    ends: Set[str] = _MET,
) -> SolverResult:
    """Return what a solver makes of x, met where it says so in these words.

    What it writes, if it does, is logged.
    """
    multipliers = multipliers or (np.zeros(bounds[0].size), np.zeros(bounds[2].size))
    with _WATCH.held(), _logged():
        x, f, _, lam_x, lam_g, _ = (value.ravel() for value in run(x, p, *bounds, *multipliers))
    status, count = run.stats()["return_status"], int(run.stats()["iter_count"])
    met = status in ends
    LOG.debug("%s after %d iterations", "met" if met else f"not met: {status}", count)
    end = SolverResult(x, lam_x, lam_g, float(f[0]), met, count)
    return end if end.is_finite else replace(end, met=False)


@contextmanager
def _logged() -> Iterator[None]:
    """Log what is written to the standard output, by one thread at a time; at DEBUG alone."""
    if not LOG.isEnabledFor(logging.DEBUG):
        yield
        return
    with _TALKING, redirect_stdout(io.StringIO()) as said:
        yield
    LOG.debug(said.getvalue().strip())
