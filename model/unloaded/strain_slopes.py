"""How the strains of a cross-section answer to the pull of its tendons, in closed form."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.statics import ClosedStatics
from model.unloaded.closed_form import full_strain


@lru_cache(maxsize=64)
def strain_slopes(statics: ClosedStatics) -> ca.Function:
    """Return (strains xi, k, q, pull, data) -> slopes (3, n_pull) of the strains against pull."""
    e, v, pull, data = _section_symbols(statics)
    residual = statics.residual(v, pull, data)
    strain = full_strain(statics, statics.strain(v), pull, data)[1:]
    turn = -_solve(ca.jacobian(residual, v), ca.jacobian(residual, pull))
    slope = ca.jacobian(strain, v) @ turn + ca.jacobian(strain, pull)
    found = ca.substitute([ca.densify(slope)], [v], [statics.unknowns(_states(statics, e))])
    return ca.Function("slopes", [e, pull, data], found, {"cse": True})


def _section_symbols(statics: ClosedStatics) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return symbols: strains xi, k, q, unknowns v, pull, data."""
    e, v = ca.SX.sym("e", 3), ca.SX.sym("v", len(statics.names))
    return e, v, ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)


def _states(statics: ClosedStatics, e: ca.SX) -> ca.SX:
    """Return those of xi, k, q that the statics carry as states."""
    kept = [e[i] for i, name in enumerate(("xi", "k", "q")) if name in statics.names]
    return ca.vertcat(*kept)


def _solve(A: ca.SX, B: ca.SX) -> ca.SX:
    """Return A^-1 B for a small matrix A, by minors."""
    return ca.inv_minor(A) @ B
