"""Quadratic programs of a dozen unknowns, by DAQP."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array


@lru_cache(maxsize=64)
def quadratic(n: int, m: int) -> Quadratic:
    """Return the solver of programs of n unknowns and m constraints."""
    return Quadratic(n, m)


class Quadratic:
    """DAQP for n unknowns with bounds and m constraints with bounds.

    Attributes
    ----------
    function : Buffered
        CasADi's conic: see its documentation for what it is given.
    """

    def __init__(self, n: int, m: int) -> None:
        shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        self.function = Buffered(ca.conic("quadratic", "daqp", shapes, {"error_on_fail": False}))
        self._rest = [np.zeros(k) for k in (n, n, m, 0, 0)]

    def __call__(
        self, H: Array, slope: Array, A: Array, lba: Array, uba: Array, lbx: Array, ubx: Array
    ) -> list[Array]:
        """Return the solution, its objective, multipliers of constraints and of bounds."""
        return self.function(H, slope, A, lba, uba, lbx, ubx, *self._rest)
