"""Dense quadratic programs by qpOASES."""

from __future__ import annotations

import logging
from functools import lru_cache
from typing import Any

import casadi as ca

from model.log_capture import logged
from model.paths import Array

LOG = logging.getLogger(__name__)


def solve_dense(**given: Array) -> dict[str, Any]:
    """Return what CasADi's conic solver of h, g, a, lba, uba, lbx, ubx returns."""
    m, n = given["a"].shape
    with logged(LOG, stdout=True):
        return dict(_solver(n, m)(**given))


@lru_cache(maxsize=32)
def _solver(n: int, m: int) -> ca.Function:
    shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    quiet: Any = {"printLevel": "none", "sparse": False, "error_on_fail": False}
    return ca.conic("quadratic", "qpoases", shape, quiet)
