"""The waypoints of a motion side by side in one program, coupled by rates of tensions and strokes.

With the unknowns x_k of each waypoint's program (tensions a_k, states, lengths l_k of tendons)
and the durations d_m from target to target, of which each waypoint on the way has its fraction s_k,

    minimise    sum effort(a_k) + w sum d_m
    subject to  g_k(x_k) within bounds                      the constraints of each waypoint
                |a_k - a_(k-1)| <= rate s_k d_m             |l_k - l_(k-1)| <= stroke rate s_k d_m
                d_m >= the time that is given for it, if any

Jacobians and Hessians are block-diagonal but for the coupling, whose rows are linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.extensions.trajectory.side_by_side import Part, SideBySide, joined
from octoplan.planner.program.problem import Problem, Solution, units
from octoplan.planner.program.program import Program
from octoplan.planner.solve.ipopt import TOGETHER, WARM

Indices = tuple[int, ...]
# Of effort over time, where time is made least; where effort is, of that over time beyond what is
# given, an exact penalty.
_WEIGHT = 3e-3
# The least effort and time that count.
_LEAST = 1e-3
# From the optimum for other defects.
_AGAIN = WARM | {"tol": 1e-8, "constr_viol_tol": 1e-9, "mu_init": 1e-8}


class MotionProgram:
    """One program of all waypoints, each with a problem of its own."""

    def __init__(
        self, question: Question, waypoints: Sequence[Waypoint], problems: Sequence[Problem]
    ) -> None:
        self._problems = problems
        guess = [each.guess(w.tensions, True) for w, each in zip(waypoints, problems, strict=True)]
        # The target to which each waypoint leads.
        group = np.cumsum([0, *(bool(waypoint.targets) for waypoint in waypoints[:-1])])
        fractions = np.array([waypoint.fraction for waypoint in waypoints])
        programs = tuple(problem.program for problem in problems)
        places, start, rate = _limited(question, programs)
        values = [start, *(x[list(at)] for x, at in zip(guess, places, strict=True))]
        slowest = (np.abs(np.diff(values, axis=0)) / rate).max(axis=1, initial=0.0) / fractions
        least = np.zeros(group[-1] + 1) if question.steps is None else question.steps
        needed = least.copy()
        np.maximum.at(needed, group, slowest)
        unit, pairs = max(float(needed.max()), _LEAST), zip(problems, guess, strict=True)
        effort = sum(float(of.program.evaluate(x, of.parameters())[0][0]) for of, x in pairs)
        penalty = max(effort, _LEAST) * unit / max(float(needed.sum()), _LEAST)
        weights = np.array([_WEIGHT, penalty]) / (1.0 if question.steps is None else _WEIGHT)
        self._numbers = [weights, start, rate * unit, fractions]
        none = np.zeros(2 * rate.size * len(waypoints))
        more = (least / unit, np.full(least.size, np.inf)), (none - np.inf, none)
        self._bounds = joined([problem.bounds for problem in problems], *more)
        self._guess = np.concatenate([*guess, needed / unit])
        self._stated = _stated(programs, tuple(group.tolist()), places)

    def solve(
        self, each: Sequence[Array], before: Solution | None = None
    ) -> tuple[Solution, list[Array]]:
        """Return the optimum by the parameters of each waypoint, and the unknowns of each there.

        Warm from that for other parameters if there is one, and cold where that leads nowhere.
        """
        x, solution = self._guess if before is None else before.x, None
        p = self._parameters(each, x)
        if before is not None:
            warm = before.lam_x, before.lam_g
            solution = self._stated.solve(_AGAIN, x, p, self._bounds, warm)
        if solution is None or not solution.met:
            solution = self._stated.solve(TOGETHER, x, p, self._bounds)
        check_time()
        return solution, self._stated.split(solution.x)[:-1]

    def violation(self, solution: Solution, each: Sequence[Array]) -> float:
        """Return by how much rows violate their bounds at most, by other parameters."""
        rows = self._stated.values(solution.x, self._parameters(each, solution.x))[1].full().ravel()
        low, high = self._bounds[2:]
        return float(np.maximum(low - rows, rows - high).max())

    def _parameters(self, each: Sequence[Array], x: Array) -> Array:
        """Return the parameters of the program, by which modes remain those in unknowns x."""
        of_each = zip(self._problems, self._stated.split(x), each, strict=False)
        parts = [problem.with_mode(part, p) for problem, part, p in of_each]
        return np.concatenate([*self._numbers, *parts])


def _limited(
    question: Question, programs: Sequence[Program]
) -> tuple[tuple[Indices, ...], Array, Array]:
    """Return what has limited rates: its places in each waypoint's unknowns, start, rates.

    The latter (m,) in the units of these unknowns.
    """
    rates, unit = question.rates, units(question.arm, question.limits)
    rate, L = np.array(rates.tension), question.arm.length
    j = np.flatnonzero(np.isfinite(rate))
    start, rate = question.start[j] / unit[j], rate[j] / unit[j]
    if not np.isfinite(rates.pace):
        return (tuple(j.tolist()),) * len(programs), start, rate
    lengths = question.lines().lengths(question.start)
    wound = [np.r_[j, of.places[of.lengths[0]]] for of in programs]
    rate = np.append(rate, np.full(lengths.size, rates.pace / L))
    return tuple(tuple(at.tolist()) for at in wound), np.append(start, lengths / L), rate


@lru_cache(maxsize=4)
def _stated(
    programs: tuple[Program, ...], group: Indices, places: tuple[Indices, ...]
) -> SideBySide:
    """Return the program of waypoints, each of which leads to a target of some duration.

    Parameters are the weights of effort and time; start and rates of what has limited rates, at
    places in the unknowns of each waypoint; the waypoints' fractions, and their parameters.
    """
    N, M, m = len(programs), group[-1] + 1, len(places[0])
    sizes = [program.size for program in programs]
    rows = [program.rows.size for program in programs]
    n_p = [2, m, m, N, *(program.p.numel() for program in programs)]
    at = SideBySide(sizes, rows, M, 2 * N * m, sum(n_p))
    weights, before, rate, fractions, *ps = ca.vertsplit(at.p, np.cumsum([0, *n_p]).tolist())
    effort, time = ca.vertsplit(weights)
    *unknowns, durations = at.unknowns
    parts, coupled, none = list[Part](), [ca.MX(0, 1)], ca.MX(M, M)
    for k, (program, x, p) in enumerate(zip(programs, unknowns, ps, strict=True)):
        symbols = x, p, effort * at.sigma, at.multipliers[k]
        f, gradient, g, J, H = program.function.call(symbols, True, False)
        first = ca.vertcat(effort * gradient, ca.MX(M, 1)), ca.horzcat(J, ca.MX(g.numel(), M))
        parts.append(Part(effort * f, first[0], g, first[1], ca.diagcat(H, none)))
        most, after = rate * fractions[k] * durations[group[k]], x[list(places[k])]
        coupled += [after - before - most, before - after - most]
        before = after
    c, slope = ca.vertcat(*coupled), time * ca.MX.ones(M)
    coupling = Part(time * ca.sum1(durations), slope, c, ca.jacobian(c, at.x), none)
    return at.stated(parts, coupling)
