"""A problem with its states eliminated: functions of what comes before them alone."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from scipy.sparse.linalg import splu

from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.equilibrium.stability import least_modes, stands
from model.errors import OctoplanError, SingularError
from model.paths import Array
from planner.program.objective import Rows
from planner.program.program import Program
from planner.program.reduced import Eliminated, Reduced
from planner.program.states import States

# Newton's steps of the states after a change of what comes before them, with the factorisation from
# before it: how many at most, the size that does, and that from which on they have to shrink.
_FOLLOWED, _NEAR, _SHRINKS = 5, 0.1, 0.9


class _Memory(threading.local):
    """What was found last; another thread asks at other points, and has a memory of its own."""

    here: Linearised | None = None
    seen: Linearised | None = None
    settled: tuple[Array, Array, Reduced] | None = None
    near: Linearised | None = None


class Condensed:
    """Unknowns a are those of a program before the states."""

    def __init__(self, program: Program, forward: Collocation, states: States) -> None:
        self.program, self.forward, self.states = program, forward, states
        self.rows: tuple[Rows, ...] = program.outer_rows
        self.n, self.m = program.n_free, sum(row.size for row in self.rows)
        self._last = _Memory()

    def forget(self, near: Linearised | None = None) -> None:
        """Begin afresh: what is found next does not depend on what was found before.

        It is found near an equilibrium that is known, if there is any there, else from rest.
        """
        self._last.here = self._last.settled = None
        self._last.near = near

    def lifted(self, a: Array, p: Array) -> Array:
        """Return all unknowns with the states that were found last, or of what is begun near.

        Raises SnapError and UnsettledSectionError where there are none.
        """
        last, near = self._last.here, self._last.near
        T = np.maximum(a[: self._unit(p).size] * self._unit(p), 0.0)
        if last is not None:
            states = last.states
        elif near is None:
            states = self.forward.found(T).states
        else:
            states = self.forward.carried(T, near)
        x = self.whole(a, states, p)
        x[: self.n] = a
        return x

    def begin_at(self, x: Array, p: Array) -> None:
        """Begin with the states in unknowns x: what is found next is near them."""
        self.forget()
        self._last.here = self._linearised(x, p)

    def apart(self) -> Condensed:
        """Return the same with a memory of its own, which begins with what was found last."""
        other = Condensed(self.program, self.forward, self.states)
        other._last.here, other._last.settled = self._last.here, self._last.settled
        other._last.near = self._last.near
        return other

    @property
    def stands(self) -> bool:
        """Whether the arm is stable where it was settled last."""
        return self._last.here is not None and stands(self._last.here)

    def first(self, a: Array, p: Array) -> Reduced:
        """Return values and first derivatives in equilibrium; NaN where the arm does not settle."""
        known = self._last.settled
        if known and np.array_equal(known[0], a) and np.array_equal(known[1], p):
            return known[2]
        here = self._settled(np.maximum(a[: self._unit(p).size] * self._unit(p), 0.0))
        found = None
        if here is not None:
            x = self.whole(a, here.states, p)
            x[: self.n] = a
            found = self._reduced(x, p, here)
        if found is None:
            n, m, nan = self.n, self.m, np.nan
            nowhere = np.full(self.program.size, nan)
            return Reduced(nowhere, nan, np.full(n, nan), np.full(m, nan), np.full((m, n), nan))
        self._last.settled = a.copy(), p.copy(), found
        return found

    def second(self, a: Array, p: Array, sigma: float, lam: Array) -> Array:
        """Return the Hessian (n, n) of sigma f + lam . g in equilibrium."""
        return self.curvature(self.first(a, p), p, sigma, lam)[0]

    def at(self, x: Array, p: Array) -> Reduced | None:
        """Return values and first derivatives at all unknowns; None where they are singular."""
        self._last.seen = self._linearised(x, p)
        return self._reduced(x, p, self._last.seen)

    def stay(self, here: Reduced, p: Array) -> None:
        """Take the point that `at` returned last for the equilibrium that was found last."""
        self._last.here, self._last.settled = self._last.seen, (here.x[: self.n].copy(), p, here)

    def curvature(self, here: Reduced, p: Array, sigma: float, lam: Array) -> tuple[Array, Array]:
        """Return the Hessian (n, n) of sigma f + lam . g, and the slope that states off add."""
        if here.states is None:
            return np.full((self.n, self.n), np.nan), np.full(self.n, np.nan)
        multipliers = np.concatenate([lam, here.states.multipliers(sigma, lam)])
        return here.states.hessian(self.program.second(here.x, p, sigma, multipliers))

    def follow(self, here: Reduced, change: Array, p: Array) -> Array | None:
        """Return all unknowns after a change of those before the states, near equilibrium.

        None where the states do not come near it.
        """
        assert here.states is not None
        x, last = here.x.copy(), np.inf
        x[: self.n] += change
        x[self.n :] += here.states.following(change)
        for _ in range(_FOLLOWED):
            step = here.states.solve(self.program.equilibrium(x, p), False)
            size = float(np.abs(step).max())
            if not size <= _SHRINKS * last:
                return None
            x[self.n + 1 :] -= step
            if size <= _NEAR:
                return x
            last = size
        return None

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints besides equilibrium at all unknowns."""
        f, g = self.program.values(x, p)
        return float(f[0, 0]), g[0]

    def multipliers(self, a: Array, p: Array, lam_x: Array, lam_g: Array) -> tuple[Array, Array]:
        """Return the multipliers of all unknowns and constraints of the program."""
        states = self.first(a, p).states
        rows = self.program.blocks.n_rows
        mu = np.zeros(rows) if states is None else states.multipliers(1.0, lam_g)
        zeros = np.zeros(self.program.size - self.n)
        return np.concatenate([lam_x, zeros]), np.concatenate([lam_g, mu])

    def whole(self, a: Array, states: Array, p: Array) -> Array:
        """Return all unknowns of the problem for states of the arm (n_states,)."""
        blocks, scale = self.program.blocks, self.states.scale
        x = np.zeros(self.program.size)
        x[: self.n], x[self.n] = a, 1.0
        x[blocks.states] = states / scale[1 : 1 + states.size]
        if blocks.responses:
            start, stop = blocks.response(0).start, blocks.response(len(blocks.responses)).start
            rows = slice(states.size, states.size + stop - start)
            responds = self.program.inner(x, p).tocsr()[rows].tocsc()[:, start:stop]
            x[start:stop] = -splu(responds).solve(self.program.equilibrium(x, p)[rows])
        if blocks.modes:
            self._add_modes(x, states, p)
        if blocks.wound:
            system = self.forward.system
            found = system.lengths(system.x(np.zeros(system.of.n_tendons), 1.0, states))
            x[blocks.lengths] = found / system.arm.length
        objective = self.program.objective
        if objective.n_lack:
            outer = self.program.values(x, p)[1][0]
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

    def _linearised(self, x: Array, p: Array) -> Linearised:
        """Return the equations of equilibrium linearised at unknowns x."""
        system = self.forward.system
        T = np.maximum(x[: system.of.n_tendons] * self._unit(p), 0.0)
        scale = self.states.scale[1 : 1 + system.of.n_states]
        states = x[self.program.blocks.states] * scale
        return Linearised(system, system.x(T, 1.0, states))

    def _unit(self, p: Array) -> Array:
        """Return what one unit of each tension is worth [N]."""
        return p[self.program.parts.unit]

    def _settled(self, T: Array) -> Linearised | None:
        """Return the equilibrium under tensions, near the last one if that leads there."""
        system, last, here = self.forward.system, self._last.here, None
        try:
            if last is not None:
                predicted = last.states + last.by_tensions @ (T - last.x[: T.size])
                here = newton(system, T, 1.0, predicted, kept=last)
            here = Linearised(system, (here or self.forward.found(T, self._last.near)).x)
            here.by_parameters  # noqa: B018  (there, or the equations are singular)
        except OctoplanError:
            return None
        self._last.here = here
        return here

    def _reduced(self, x: Array, p: Array, here: Linearised) -> Reduced | None:
        """Return the program linearised at unknowns x, whose states are those of `here`."""
        n = self.n
        f, gradient, g, J = self.program.first(x, p)
        gradient, g, J = gradient[0], g[0], J.T
        try:
            moves, solve = self._eliminated(x, p, here)
        except (SingularError, RuntimeError):  # "exactly singular", in SciPy's words
            return None
        slopes = np.asfortranarray(np.vstack([J[:, n:], gradient[n:]]))
        states = Eliminated(moves, slopes, solve)
        moved = states.moved()
        own = gradient[:n] + moved[-1, :n], g + moved[:-1, n], J[:, :n] + moved[:-1, :n]
        return Reduced(x, float(f[0, 0]), *own, states)

    def _eliminated(
        self, x: Array, p: Array, here: Linearised
    ) -> tuple[Array, Callable[[Array, bool], Array]]:
        """Return (Z, z), and the solution of linear systems with c_S or its transpose.

        The load factor, which stays, has a row of zeros.
        """
        n, unit = self.n, self._unit(p)
        moves = np.zeros((x.size - n, n + 1), order="F")
        if self.program.blocks.n_answers:
            inner = self.program.inner(x, p)
            factor = splu(inner[:, n + 1 :])
            moves[1:, :n] = -factor.solve(inner[:, :n].toarray())
            moves[1:, n] = -factor.solve(self.program.equilibrium(x, p))
            return moves, lambda right, transposed: factor.solve(right, "NT"[transposed])
        column, row = self.states.scale[1:], self.states.row_scale
        moves[1:, : unit.size] = here.by_tensions * unit / column[:, None]
        moves[1:, n] = -here.solve(here.residual) / column

        def solve(right: Array, transposed: bool) -> Array:
            if transposed:
                return np.asarray(row * here.solve(right / column, True))
            return np.asarray(here.solve(right * row) / column)

        return moves, solve
