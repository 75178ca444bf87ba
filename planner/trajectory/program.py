"""The waypoints of a motion side by side in one program, coupled by rates of tensions and strokes.

With the unknowns x_k of each waypoint's own program (tensions a_k, states, lengths l_k of tendons)
and the durations d_m from target to target, of which each waypoint on the way has its share s_k,

    minimise    sum effort(a_k) + w sum d_m
    subject to  g_k(x_k) within bounds                      each waypoint's own constraints
                |a_k - a_(k-1)| <= rate s_k d_m             |l_k - l_(k-1)| <= stroke rate s_k d_m
                d_m >= the time that is given for it, if any

Jacobians and Hessians are block-diagonal but for the coupling, whose rows are linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, vstack

from model.machine.buffered import Buffered
from model.paths import Array
from model.time_limit import check_time
from planner.program.problem import Bounds, Problem
from planner.program.program import Program
from planner.solve.ipopt import (
    COLD,
    WARM,
    Options,
    Solution,
    derivatives,
    named,
    nlp_solver,
    solved,
)
from planner.targets.base import Target

Counts = NDArray[np.int64]
# Of effort over time, where time is made least; where effort is, of that over time beyond what is
# given, an exact penalty.
_WEIGHT = 3e-3
# The least effort and time that count, and what durations of a guess have to spare, of the longest.
_LEAST, _SPARE = 1e-3, 0.1
# From the waypoints by themselves, where no guess is cheaper; from the optimum for other defects.
_FIRST = COLD | {"max_iter": 300}
_AGAIN = WARM | {"tol": 1e-8, "constr_viol_tol": 1e-9, "mu_init": 1e-8}
_functions: WeakKeyDictionary[Program, dict[str, ca.Function]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint as a program of its own for targets, with its parameters and bounds."""

    problem: Problem
    targets: tuple[Target, ...]
    p: Array
    bounds: Bounds

    @property
    def program(self) -> Program:
        """Its structure."""
        return self.problem.program


@dataclass(frozen=True, eq=False)
class Coupling:
    """What couples waypoints.

    Attributes
    ----------
    start, start_lengths : (n_tendons,)
        Tensions [N] and lengths of tendons [m] where the motion begins.
    unit : (n_tendons,)
        What one unit of each tension is worth [N].
    rate : (n_tendons,)
        Of tensions [N/s]; may be infinite.
    stroke : float
        Rate of lengths [m/s]; may be infinite.
    group, shares : (N,)
        The target to which each waypoint leads; of the time to it, the share in which the arm goes
        there from the waypoint before.
    steps : (M,) or None
        The time that is given from target to target [s]; then effort is made least, else time.
    """

    start: Array
    start_lengths: Array
    unit: Array
    rate: Array
    stroke: float
    group: Counts
    shares: Array
    steps: Array | None


class MotionProgram:
    """One program of all waypoints.

    Attributes
    ----------
    x : (size,)
        Where it begins: the unknowns of each waypoint, then the durations, scaled.
    """

    def __init__(self, stops: Sequence[Stop], coupling: Coupling, guess: Sequence[Array]) -> None:
        self.stops, self.coupling = stops, coupling
        self.ends = np.cumsum([0, *(stop.program.size for stop in stops)]).tolist()
        values = [stop.program.evaluate(x, stop.p).f for stop, x in zip(stops, guess, strict=True)]
        effort, needed, steps = float(np.sum(values)), self._needed(guess), coupling.steps
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
        lbx, ubx, lbg, ubg = (
            np.concatenate(parts) for parts in zip(*(stop.bounds for stop in stops), strict=True)
        )
        bounds = (
            np.concatenate([lbx, self.least / self.unit]),
            np.concatenate([ubx, np.full(M, np.inf)]),
            np.concatenate([lbg, np.full(most.size, -np.inf)]),
            np.concatenate([ubg, most]),
        )
        p = np.concatenate([stop.p for stop in stops])
        if before is not None:
            known, run = (before.lam_x, before.lam_g), self._solver(matrix, _AGAIN)
            solution = solved(run, before.x, p, bounds, known)
            check_time()
            if solution.met:
                return solution
        start = self.x if before is None else before.x
        solution = solved(self._solver(matrix, _FIRST), start, p, bounds)
        check_time()
        return solution

    def _changes(self) -> list[tuple[Counts, Array, Array]]:
        """Return what has limited rates: places (N, m) in x, scaled values at the start, rates."""
        of, begins = self.coupling, np.array(self.ends[:-1])[:, None]
        finite = np.flatnonzero(np.isfinite(of.rate))
        unit = of.unit[finite]
        changes = [(begins + finite, of.start[finite] / unit, of.rate[finite] / unit)]
        if np.isfinite(of.stroke):
            L, n = self.stops[0].problem.arm.length, of.unit.size
            first = np.array([[stop.program.blocks.lengths.start] for stop in self.stops])
            places = begins + first + np.arange(n)
            changes.append((places, of.start_lengths / L, np.full(n, of.stroke / L)))
        return changes

    def _needed(self, guess: Sequence[Array]) -> Array:
        """Return the least durations (M,) of unknowns of the waypoints [s]."""
        x, of = np.concatenate(guess), self.coupling
        needed = np.zeros(of.group[-1] + 1)
        for places, start, rate in self._changes():
            steps = np.abs(np.diff(x[places], axis=0, prepend=start[None])) / rate
            np.maximum.at(needed, of.group, steps.max(axis=1, initial=0.0) / of.shares)
        return needed

    def _coupled(self) -> tuple[csc_array, Array]:
        """Return the matrix of the rows that couple waypoints, and what these are at most."""
        of, size = self.coupling, self.ends[-1]
        durations, shares = size + of.group[:, None], self.unit * of.shares[:, None]
        parts, most = [csc_array((0, size + self.least.size))], [np.zeros(0)]
        for places, start, rate in self._changes():
            rows = np.arange(places.size).reshape(places.shape)
            ones = np.ones(places.shape)
            shape = (places.size, size + self.least.size)
            moved = _entries(shape, (rows, places, ones), (rows[1:], places[:-1], -ones[1:]))
            pace = _entries(shape, (rows, durations + 0 * places, rate * shares * ones))
            begin = np.concatenate([start, np.zeros(rows[1:].size)])
            parts += [moved - pace, -moved - pace]
            most += [begin, -begin]
        return csc_array(vstack(parts)), np.concatenate(most)

    def _solver(self, matrix: csc_array, way: Options) -> Buffered:
        """Return what solves the program, of whose linear rows the matrix is given."""
        stops, M, (effort, time) = self.stops, self.least.size, self.weights
        rows = np.cumsum([0, *(stop.bounds[2].size for stop in stops)]).tolist()
        sizes = np.cumsum([0, *(stop.p.size for stop in stops)]).tolist()
        matrix.sort_indices()
        m, n = matrix.shape
        places = ca.Sparsity(m, n, matrix.indptr.tolist(), matrix.indices.tolist())
        coupled = ca.DM(places, matrix.data)
        x, p = ca.MX.sym("x", matrix.shape[1]), ca.MX.sym("p", sizes[-1])
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", rows[-1] + matrix.shape[0])
        xs, ps = ca.vertsplit(x, [*self.ends, x.numel()]), ca.vertsplit(p, sizes)
        lams = ca.vertsplit(lam, [*rows, lam.numel()])
        of = [functions(stop.program) for stop in stops]
        each = list(zip(of, xs, ps, strict=False))
        slopes = [effort * own["grad_f"](a, b)[1] for own, a, b in each]
        first = ca.diagcat(*(own["jac_g"](a, b)[1] for own, a, b in each))
        weighted = zip(each, lams, strict=False)
        second = [own["hess_lag"](a, b, effort * sigma, mu) for (own, a, b), mu in weighted]
        f = effort * sum(own["f"](a, b) for own, a, b in each) + time * ca.sum1(xs[-1])
        g = ca.vertcat(*(own["g"](a, b) for own, a, b in each), ca.mtimes(coupled, x))
        return nlp_solver(
            {"x": x, "p": p, "f": f, "g": g},
            named(
                (x, p, sigma, lam),
                # ipopt asks for values apart.
                (ca.MX(1, 1), ca.vertcat(*slopes, time * ca.MX.ones(M))),
                (ca.MX(*g.shape), ca.vertcat(ca.horzcat(first, ca.MX(rows[-1], M)), coupled)),
                ca.diagcat(*second, ca.MX(M, M)),
            ),
            way,
        )


def _entries(shape: tuple[int, int], *entries: tuple[Counts, Counts, Array]) -> csc_array:
    """Return the sparse matrix of entries: rows, columns, values of one shape each."""
    row, column, value = (np.concatenate([np.ravel(own[i]) for own in entries]) for i in range(3))
    return csc_array((value, (row, column)), shape=shape)


def functions(program: Program) -> dict[str, ca.Function]:
    """Return a waypoint's program as functions: values and derivatives."""
    if program not in _functions:
        of = program.symbols
        at = [of.x, of.p]
        values = {"f": ca.Function("f", at, [of.f]), "g": ca.Function("g", at, [of.g])}
        _functions[program] = values | derivatives(of)
    return _functions[program]
