"""A problem with its states eliminated: functions of the tensions alone, by settling the arm.

With c = 0 the equations of equilibrium, S the states and a what comes before them, the states move
by Z = dS/da = -c_S^-1 c_a, so that

    gradient = f_a + Z^T f_S        Jacobian = g_a + g_S Z        Hessian = (1, Z)^T H (1, Z)

where H is the Hessian of f + lam . g + mu . c with the multipliers mu = -c_S^-T (f_S + g_S^T lam):
the implicit function theorem, first and second order, exact.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.equilibrium.stability import least_modes
from model.errors import OctoplanError, SingularError
from model.paths import Array
from planner.program.program import Program, Rows
from planner.program.states import States


class First(NamedTuple):
    """Values and first derivatives at a point.

    Attributes
    ----------
    f : float
    gradient : (n,)
    g : (m,)
    jacobian : (m, n)
    """

    f: float
    gradient: Array
    g: Array
    jacobian: Array


class _Memory(threading.local):
    """What was found last; another thread asks at other points, and has a memory of its own."""

    here: Linearised | None = None
    point: _Point | None = None


class Condensed:
    """Unknowns a are those of a program before the states."""

    def __init__(self, program: Program, forward: Collocation, states: States) -> None:
        self.program, self.forward, self.states = program, forward, states
        self.rows: tuple[Rows, ...] = program.outer_rows
        self.n, self.m = program.n_free, sum(row.size for row in self.rows)
        self._last = _Memory()

    def forget(self) -> None:
        """Begin afresh: what is found next does not depend on what was found before."""
        self._last.here = self._last.point = None

    def first(self, a: Array, p: Array) -> First:
        """Return values and first derivatives; NaN where the arm does not settle."""
        point = self._at(a, p)
        if point is None:
            nan = np.full(self.n, np.nan)
            return First(np.nan, nan, np.full(self.m, np.nan), np.full((self.m, self.n), np.nan))
        n, Z = self.n, point.Z
        gradient = point.gradient[:n] + Z.T @ point.gradient[n:]
        jacobian = point.jacobian[:, :n].toarray() + point.jacobian[:, n:] @ Z
        return First(point.f, gradient, point.g, np.asarray(jacobian))

    def second(self, a: Array, p: Array, sigma: float, lam: Array) -> Array:
        """Return the Hessian (n, n) of sigma f + lam . g."""
        point = self._at(a, p)
        if point is None:
            return np.full((self.n, self.n), np.nan)
        multipliers = np.concatenate([lam, self._mu(point, sigma, lam)])
        H = _sparse(self.program.second(point.x, p, sigma, multipliers))
        moved = np.vstack([np.eye(self.n), point.Z])
        return np.asarray(moved.T @ (H @ moved))

    def multipliers(self, a: Array, p: Array, lam_x: Array, lam_g: Array) -> tuple[Array, Array]:
        """Return the multipliers of all unknowns and constraints of the program."""
        point = self._at(a, p)
        rows = self.program.blocks.n_rows
        mu = np.zeros(rows) if point is None else self._mu(point, 1.0, lam_g)
        zeros = np.zeros(self.program.x.numel() - self.n)
        return np.concatenate([lam_x, zeros]), np.concatenate([lam_g, mu])

    def _mu(self, point: _Point, sigma: float, lam: Array) -> Array:
        """Return the multipliers of equilibrium."""
        slope = sigma * point.gradient[self.n :] + point.jacobian[:, self.n :].T @ lam
        return -point.solve(slope[1:], True)

    def whole(self, a: Array, states: Array, p: Array) -> Array:
        """Return all unknowns of the problem for states of the arm (n_states,)."""
        blocks, scale = self.program.blocks, self.states.scale
        x = np.zeros(self.program.x.numel())
        x[: self.n], x[self.n] = a, 1.0
        x[blocks.states] = states / scale[1 : 1 + states.size]
        if blocks.responses:
            start, stop = blocks.response(0).start, blocks.response(len(blocks.responses)).start
            _, _, g, J = self.program.first(x, p)
            first = self.m + states.size
            rows = slice(first, first + stop - start)
            responds = _sparse(J).tocsr()[rows].tocsc()[:, start:stop]
            x[start:stop] = -splu(responds).solve(np.array(g).ravel()[rows])
        if blocks.modes:
            self._add_modes(x, states, p)
        if blocks.wound:
            system = self.forward.system
            found = system.lengths(system.x(np.zeros(system.of.n_tendons), 1.0, states))
            x[blocks.lengths] = found / system.arm.length
        objective = self.program.objective
        if objective.n_lack:
            outer = np.array(self.program.outer_first(x, p)[2]).ravel()
            x[self.n - objective.n_lack : self.n] = np.maximum(-outer[objective.lack_rows], 0.0)
        return x

    def _add_modes(self, x: Array, states: Array, p: Array) -> None:
        """Put the least stable modes at states into unknowns x."""
        blocks, system = self.program.blocks, self.forward.system
        T = np.maximum(x[: system.of.n_tendons] * self._unit(p), 0.0)
        values, y = least_modes(Linearised(system, system.x(T, 1.0, states)), blocks.modes)
        y = self.states.mode_size(y)
        for k, value in enumerate(values):
            x[blocks.mode(k)] = y[:, k] / self.states.scale[1 : 1 + states.size]
            x[blocks.mode(k).stop] = value

    def _unit(self, p: Array) -> Array:
        """Return what one unit of each tension is worth [N]."""
        start = self.program.sizes[0]
        return p[start : start + self.program.sizes[1]]

    def _settled(self, T: Array) -> Linearised | None:
        """Return the equilibrium under tensions, near the last one if that leads there."""
        system, last, here = self.forward.system, self._last.here, None
        try:
            if last is not None:
                predicted = last.states + last.by_tensions @ (T - last.x[: T.size])
                here = newton(system, T, 1.0, predicted, kept=last)
            here = Linearised(system, (here or self.forward.found(T)).x)
            here.by_parameters  # noqa: B018  (there, or the equations are singular)
        except OctoplanError:
            return None
        self._last.here = here
        return here

    def _at(self, a: Array, p: Array) -> _Point | None:
        known = self._last.point
        if known and np.array_equal(known.a, a) and np.array_equal(known.p, p):
            return known
        unit = self._unit(p)
        here = self._settled(np.maximum(a[: unit.size] * unit, 0.0))
        if here is None:
            return None
        try:
            x = self.whole(a, here.states, p)
            x[: self.n] = a
            Z, solve = self._eliminated(here, x, p, unit)
        except (SingularError, RuntimeError):  # "exactly singular", in SciPy's words
            return None
        f, gradient, g, J = self.program.outer_first(x, p)
        values = (np.array(gradient).ravel(), np.array(g).ravel(), _sparse(J).tocsr())
        self._last.point = _Point(a.copy(), p.copy(), x, float(f), *values, solve, Z)
        return self._last.point

    def _eliminated(
        self, here: Linearised, x: Array, p: Array, unit: Array
    ) -> tuple[Array, Callable[[Array, bool], Array]]:
        """Return Z, and the solution of linear systems with c_S or its transpose.

        The load factor, which stays, has a row of zeros.
        """
        n, Z = self.n, np.zeros((x.size - self.n, self.n))
        if self.program.blocks.n_answers:
            inner = _sparse(self.program.first(x, p)[3])[self.m :]
            factor = splu(inner[:, n + 1 :].tocsc())
            Z[1:] = -factor.solve(inner[:, :n].toarray())
            return Z, lambda right, transposed: factor.solve(right, "NT"[transposed])
        column, row = self.states.scale[1:], self.states.row_scale
        Z[1:, : unit.size] = here.by_tensions * unit / column[:, None]

        def solve(right: Array, transposed: bool) -> Array:
            if transposed:
                return np.asarray(row * here.solve(right / column, True))
            return np.asarray(here.solve(right * row) / column)

        return Z, solve


class _Point(NamedTuple):
    """What is known at a point."""

    a: Array
    p: Array
    x: Array
    f: float
    gradient: Array
    g: Array
    jacobian: Any
    solve: Callable[[Array, bool], Array]
    Z: Array


def _sparse(A: ca.DM) -> Any:
    """Return a sparse matrix of CasADi's."""
    places = A.sparsity()
    return csc_array((np.array(A.nonzeros()), places.row(), places.colind()), shape=A.shape)
