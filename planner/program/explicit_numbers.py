"""An explicit program as numbers: by CasADi, or by C along the arm and kernels of its targets."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array
from model.unloaded.steps_in_c import StepsInC
from planner.program.expressions import Expressions, Outer


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


class ExplicitInC:
    """The same by C along the arm; x begins with n tensions, in units that are the last of p."""

    def __init__(self, steps: StepsInC, outer: Outer, n: int) -> None:
        self._steps, self._n = steps, n
        self._value, self._first = Buffered(outer.value), Buffered(outer.first)
        self._weights, self._second = Buffered(outer.weights), Buffered(outer.second)

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints."""
        poses, stretch = self._steps.values(self._tensions(x, p))
        f, g = self._value(x, p, poses.ravel(), stretch)
        return float(f[0, 0]), g[0]

    def first(self, x: Array, p: Array) -> tuple[float, Array, Array, Array]:
        """Return f, its gradient, g and its Jacobian."""
        poses, stretch, seen = self._steps.first(self._tensions(x, p))
        f, gradient, g, J = self._first(x, p, poses.ravel(), stretch, seen.ravel("F"))
        return float(f[0, 0]), gradient[0], g[0], J.T

    def second(self, x: Array, p: Array, sigma: float, lam: Array) -> Array:
        """Return the Hessian of sigma f + lam . g."""
        T, along = self._tensions(x, p), (np.array([sigma]), lam)
        poses, stretch, seen = self._steps.first(T)
        given = (x, p, poses.ravel(), stretch)
        weights, thin = self._weights(*given, *along)
        bent = self._steps.second(T, weights, thin.ravel())
        return self._second(*given, seen.ravel("F"), *along, bent.ravel("F"))[0]

    def _tensions(self, x: Array, p: Array) -> Array:
        return np.asarray(x[: self._n] * p[-self._n :])
