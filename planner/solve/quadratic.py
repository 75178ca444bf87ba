"""Quadratic programs of a dozen unknowns, by DAQP."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array

# What constraints may be missed by that do not hold: DAQP's own.
_MISSED = 1e-6


@lru_cache(maxsize=64)
def quadratic(n: int, m: int, missed: float = _MISSED) -> Quadratic:
    """Return the solver of programs of n unknowns and m constraints.

    Constraints that are not taken for active may be `missed` by so much.
    """
    return Quadratic(n, m, missed)


class Quadratic:
    """DAQP for n unknowns with bounds and m constraints with bounds.

    Attributes
    ----------
    function : Buffered
        CasADi's conic: see its documentation for what it is given.
    """

    def __init__(self, n: int, m: int, missed: float) -> None:
        shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        options: dict[str, Any] = {"error_on_fail": False, "daqp": {"primal_tol": missed}}
        self.function = Buffered(ca.conic("quadratic", "daqp", shapes, options))
        self._rest = [np.zeros(k) for k in (n, n, m, 0, 0)]

    def __call__(
        self, H: Array, slope: Array, A: Array, lba: Array, uba: Array, lbx: Array, ubx: Array
    ) -> list[Array]:
        """Return the solution, its objective, multipliers of constraints and of bounds."""
        return self.function(H, slope, A, lba, uba, lbx, ubx, *self._rest)
