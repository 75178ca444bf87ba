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
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, vstack

from model.paths import Array
from model.time_limit import check_time
from planner.avoidance.rows import Avoidance
from planner.program.problem import Bounds, Problem, units
from planner.program.program import Program
from planner.solve.ipopt import TOGETHER, WARM, Solution, derivatives
from planner.solve.side_by_side import Part, SideBySide, joined
from planner.targets.base import Target
from planner.trajectory.question import Question

Counts = NDArray[np.int64]
# Of effort over time, where time is made least; where effort is, of that over time beyond what is
# given, an exact penalty.
_WEIGHT = 3e-3
# The least effort and time that count, and what durations of a guess have to spare, of the longest.
_LEAST, _SPARE = 1e-3, 0.1
# From the optimum for other defects.
_AGAIN = WARM | {"tol": 1e-8, "constr_viol_tol": 1e-9, "mu_init": 1e-8}
_functions: WeakKeyDictionary[Program, dict[str, ca.Function]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `fraction` is that of the time between two targets in which the arm goes there from the waypoint
    before.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Avoidance | None = None
    fraction: float = 1.0

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        rows = self.avoidance is not None and bool(self.avoidance.rows)
        return (*self.targets, self.avoidance) if rows else self.targets  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint as a program of its own, with its parameters and bounds."""

    waypoint: Waypoint
    problem: Problem
    p: Array
    bounds: Bounds

    @property
    def program(self) -> Program:
        """Its structure."""
        return self.problem.program


class MotionProgram:
    """One program of all waypoints.

    Attributes
    ----------
    x : (size,)
        Where it begins: the unknowns of each waypoint, then the durations, scaled.
    """

    def __init__(self, question: Question, stops: Sequence[Stop], guess: Sequence[Array]) -> None:
        self.question, self.stops = question, stops
        waypoints = [stop.waypoint for stop in stops]
        # The target to which each leads, and its part of the time to it.
        self._group = np.cumsum([0, *(bool(waypoint.targets) for waypoint in waypoints[:-1])])
        self._fractions = np.array([waypoint.fraction for waypoint in waypoints])
        self.ends = np.cumsum([0, *(stop.program.size for stop in stops)]).tolist()
        self._limited = self._changes()
        values = [stop.program.evaluate(x, stop.p).f for stop, x in zip(stops, guess, strict=True)]
        effort, needed, steps = float(np.sum(values)), self._needed(guess), question.steps
        if steps is not None:
            needed = np.maximum(needed, steps)
        self.least = np.zeros(needed.size) if steps is None else steps
        self.unit = max(float(needed.max()), _LEAST)
        penalty = max(effort, _LEAST) * self.unit / max(float(needed.sum()), _LEAST)
        self.weights = (_WEIGHT, penalty) if steps is None else (1.0, penalty / _WEIGHT)
        self.x = np.concatenate([*guess, needed / self.unit + _SPARE])

    def waypoints(self, x: Array) -> list[Array]:
        """Return the unknowns of each waypoint."""
        return np.split(x, self.ends[1:])[:-1]

    def solve(self, stops: Sequence[Stop], before: Solution | None = None) -> Solution:
        """Return the optimum, warm from that for other numbers of the waypoints if there is one."""
        matrix, most = self._coupled()
        M = self.least.size
        common = self.least / self.unit, np.full(M, np.inf)
        coupled = np.full(most.size, -np.inf), most
        bounds = joined([stop.bounds for stop in stops], common, coupled)
        p = np.concatenate([self.weights, matrix.data, *(stop.p for stop in stops)])
        places = tuple(matrix.indptr.tolist()), tuple(matrix.indices.tolist())
        program = _stated(tuple(stop.program for stop in stops), M, most.size, places)
        if before is not None:
            multipliers = before.lam_x, before.lam_g
            solution = program.solve(_AGAIN, before.x, p, bounds, multipliers)
            check_time()
            if solution.met:
                return solution
        solution = program.solve(TOGETHER, self.x if before is None else before.x, p, bounds)
        check_time()
        return solution

    def _changes(self) -> list[tuple[Counts, Array, Array]]:
        """Return what has limited rates: places (N, m) in x, scaled values at the start, rates."""
        question, begins = self.question, np.array(self.ends[:-1])[:, None]
        rates, unit = question.rates, units(question.arm, question.limits)
        rate = np.array(rates.tension)
        j = np.flatnonzero(np.isfinite(rate))
        changes = [(begins + j, question.start[j] / unit[j], rate[j] / unit[j])]
        if np.isfinite(rates.pace):
            L, n = question.arm.length, unit.size
            of_stops = [stop.program for stop in self.stops]
            first = np.array([[of.place_of(of.lengths[0]).start] for of in of_stops])
            lengths = question.lines().lengths(question.start)
            places = begins + first + np.arange(n)
            changes.append((places, lengths / L, np.full(n, rates.pace / L)))
        return changes

    def _needed(self, guess: Sequence[Array]) -> Array:
        """Return the least durations (M,) of unknowns of the waypoints [s]."""
        x, needed = np.concatenate(guess), np.zeros(self._group[-1] + 1)
        for places, start, rate in self._limited:
            steps = np.abs(np.diff(x[places], axis=0, prepend=start[None])) / rate
            np.maximum.at(needed, self._group, steps.max(axis=1, initial=0.0) / self._fractions)
        return needed

    def _coupled(self) -> tuple[csc_array, Array]:
        """Return the matrix of the rows that couple waypoints, and what these are at most."""
        size, fractions = self.ends[-1], self.unit * self._fractions[:, None]
        durations = size + self._group[:, None]
        parts, most = [csc_array((0, size + self.least.size))], [np.zeros(0)]
        for places, start, rate in self._limited:
            rows = np.arange(places.size).reshape(places.shape)
            ones = np.ones(places.shape)
            shape = (places.size, size + self.least.size)
            changes = _entries(shape, (rows, places, ones), (rows[1:], places[:-1], -ones[1:]))
            pace = _entries(shape, (rows, durations + 0 * places, rate * fractions * ones))
            begin = np.concatenate([start, np.zeros(rows[1:].size)])
            parts += [changes - pace, -changes - pace]
            most += [begin, -begin]
        matrix = csc_array(vstack(parts))
        matrix.sort_indices()
        return matrix, np.concatenate(most)


def _entries(shape: tuple[int, int], *entries: tuple[Counts, Counts, Array]) -> csc_array:
    """Return the sparse matrix of entries: rows, columns, values of one shape each."""
    row, column, value = (
        np.concatenate([np.ravel(entry[i]) for entry in entries]) for i in range(3)
    )
    return csc_array((value, (row, column)), shape=shape)


@lru_cache(maxsize=4)
def _stated(
    programs: tuple[Program, ...], M: int, coupled: int, places: tuple[tuple[int, ...], ...]
) -> SideBySide:
    """Return the program of waypoints and M durations, with so many linear rows that couple them.

    Parameters are the weights of effort and time, the matrix of these rows, of which the places of
    nonzeros are given, and the parameters of each waypoint.
    """
    sizes = [program.size for program in programs]
    rows = [sum(row.size for row in program.rows) for program in programs]
    of = {program: functions(program) for program in programs}
    n_p = [2, len(places[1]), *(program.parts.size for program in programs)]

    def state(at: SideBySide) -> tuple[list[Part], Part]:
        weights, nonzeros, *ps = ca.vertsplit(at.p, np.cumsum([0, *n_p]).tolist())
        effort, time = ca.vertsplit(weights)
        matrix = ca.MX(ca.Sparsity(coupled, sum(sizes) + M, *map(list, places)), nonzeros)
        parts, none = [], ca.MX(M, M)
        for program, x, p, lam in zip(programs, at.unknowns, ps, at.multipliers, strict=False):
            f, g = of[program]["f"](x, p), of[program]["g"](x, p)
            gradient = ca.vertcat(effort * of[program]["grad_f"](x, p)[1], ca.MX(M, 1))
            J = ca.horzcat(of[program]["jac_g"](x, p)[1], ca.MX(g.numel(), M))
            H = of[program]["hess_lag"](x, p, effort * at.sigma, lam)
            parts.append(Part(effort * f, gradient, g, J, ca.diagcat(H, none)))
        durations = at.unknowns[-1]
        slope = time * ca.MX.ones(M)
        return parts, Part(time * ca.sum1(durations), slope, matrix @ at.x, matrix, none)

    return SideBySide(sizes, rows, M, coupled, sum(n_p), state)


def functions(program: Program) -> dict[str, ca.Function]:
    """Return a waypoint's program as functions: values and derivatives."""
    if program not in _functions:
        at = [program.x, program.p]
        values = {name: ca.Function(name, at, [getattr(program, name)]) for name in "fg"}
        _functions[program] = values | derivatives(program)
    return _functions[program]
