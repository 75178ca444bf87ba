"""Columns of a linear solution, made orthonormal on their way."""

from __future__ import annotations

import casadi as ca
import numpy as np


class Orthonormal:
    """Changes of state A w + a as Q w' + a', with w' = R w + c and Q^T D^2 (Q, a') = (1, 0).

    By Gram-Schmidt on the rows that count; R is upper triangular.

    Attributes
    ----------
    columns : casadi.Function
        (A, a) (n, n_w + m) -> (Q, a') (n, n_w + m), R (n_w, n_w), c (n_w, m).
    before : casadi.Function
        (R, v (n_w, m)) -> R^-1 v.
    """

    def __init__(self, weights: tuple[float, ...], n_w: int, m: int) -> None:
        rows = np.flatnonzero(weights).tolist()
        D = ca.DM(weights)[rows]
        move = ca.SX.sym("move", len(weights), n_w + m)
        A, a = move[:, :n_w], move[:, n_w:]
        Q, R = ca.qr(D * A[rows, :])
        c = Q.T @ (D * a[rows, :])
        columns = ca.solve(R.T, A.T).T
        outputs = [ca.horzcat(columns, a - columns @ c), R, c]
        self.columns = ca.Function("orthonormal", [move], outputs, {"cse": True})
        r, v = ca.SX.sym("R", ca.Sparsity.upper(n_w)), ca.SX.sym("v", n_w, m)
        self.before = ca.Function("before", [r, v], [ca.solve(r, v)], {"cse": True})
