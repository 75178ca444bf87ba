"""An explicit program as numbers, by CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array
from planner.program.expressions import Expressions


class ExplicitByCasadi:
    """f, g, their first derivatives and the Hessian, by functions of a program in symbols."""

    def __init__(self, of: Expressions) -> None:
        at, along = [of.x, of.p], [of.x, of.p, of.sigma, of.lam]
        first = [ca.densify(v) for v in (of.f, of.gradient, of.g, of.jacobian)]
        self._value = Buffered(ca.Function("value", at, [of.f, ca.densify(of.g)]))
        self._first = Buffered(ca.Function("first", at, first))
        self._second = Buffered(ca.Function("second", along, [ca.densify(of.hessian)]))

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints."""
        f, g = self._value(x, p)
        return float(f[0, 0]), g[0]

    def first(self, x: Array, p: Array) -> tuple[float, Array, Array, Array]:
        """Return f, its gradient, g and its Jacobian."""
        f, gradient, g, J = self._first(x, p)
        return float(f[0, 0]), gradient[0], g[0], J.T

    def second(self, x: Array, p: Array, sigma: float, lam: Array) -> Array:
        """Return the Hessian of sigma f + lam . g."""
        return self._second(x, p, np.array([sigma]), lam)[0]
