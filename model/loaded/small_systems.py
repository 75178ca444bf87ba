"""Linear systems inside of expressions."""

from __future__ import annotations

import casadi as ca

# CasADi's solver for dense systems: the sparse one that is the default fails on tiny entries.
DENSE = "lapackqr"


def solve_small(A: ca.MX, B: ca.MX) -> ca.MX:
    """Return A^-1 B, for A (n, n) of a few unknowns.

    By blocks of the structural triangular form, each by orthogonal columns: it has no tolerances,
    prints nothing, gives NaN for a singular A, and is differentiated, expanded and compiled as any
    expression, which CasADi's linear solvers are not.
    """
    a, b = ca.SX.sym("A", A.sparsity()), ca.SX.sym("B", B.sparsity())
    return ca.Function("solve", [a, b], [ca.densify(ca.solve(a, b))], {"cse": True})(A, B)
