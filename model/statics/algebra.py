"""Small linear systems, written out as expressions."""

from __future__ import annotations

import casadi as ca


def solve_symmetric(A: ca.SX, rhs: ca.SX, least: ca.SX | None = None) -> ca.SX:
    """Return A^-1 rhs for a small symmetric A (n, n) and rhs (n, k), by A = L D L^T.

    With `least` (n,), pivots below it are raised to it.
    """
    n = A.shape[0]
    L, D = ca.SX.eye(n), [ca.SX(0)] * n
    for j in range(n):
        D[j] = A[j, j] - sum((L[j, k] ** 2 * D[k] for k in range(j)), ca.SX(0))
        if least is not None:
            D[j] = ca.fmax(D[j], least[j])
        for i in range(j + 1, n):
            inner = sum((L[i, k] * L[j, k] * D[k] for k in range(j)), ca.SX(0))
            L[i, j] = (A[i, j] - inner) / D[j]
    x = [rhs[i, :] for i in range(n)]
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - L[i, k] * x[k]
    x = [row / d for row, d in zip(x, D, strict=True)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - L[k, i] * x[k]
    return ca.vertcat(*x)
