"""Newton steps to the tensions that lengths call for, several in one call.

Each linearises the lengths and solves the linear complementarity problem of taut and slack tendons
by block principal pivoting (see model.equilibrium.complementarity), a fixed number of times:
whether these were enough is told, and is for the caller to look at.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.machine.compiled import kernel

# From rest which tendons are taut is found by so many exchanges, after that by so many.
_FIRST, _LATER = 5, 2
# Steps far from the lengths are damped in the combinations of tensions that hardly change these.
_DAMPED, _LEAST = 1e-3, 1e-300
# Rounding, against the largest number of its kind.
_TINY = 1e-14


def newton_steps(lengths: ca.Function, steps: int, machine_code: bool = False) -> ca.Function:
    """Return T, l, J, left, soft, held -> T after steps, the next T, wrong, l and J, and more.

    `lengths` takes tensions T (n,) [N] to lengths l (n,) [m] and their derivatives J (n, n) [m/N],
    and may tell more, which is handed on.
    Winches leave `left` (n,) [m] of tendons that stretch by `soft` (n,) [m/N] where `held` (n,) is
    1; elsewhere tensions stay. `wrong` is how many tendons are on the wrong side, taut or slack,
    for want of exchanges in the last step.
    """
    n = lengths.numel_in(0)
    exchange = kernel(_exchange(n), machine_code)
    start = [ca.MX.sym("T", n), ca.MX.sym("l", n), ca.MX.sym("J", n, n)]
    given = [ca.MX.sym(name, n) for name in ("left", "soft", "held")]
    (T, at, J), exchanges = start, _FIRST
    for _ in range(steps):
        T, _ = _solved(exchange, exchanges, (T, at, J), given)
        (at, J, *more), exchanges = lengths(T), _LATER
    to, wrong = _solved(exchange, exchanges, (T, at, J), given)
    return ca.Function("newton_steps", [*start, *given], [T, to, wrong, at, J, *more])


def _solved(
    exchange: ca.Function, times: int, at: tuple[ca.MX, ca.MX, ca.MX], given: list[ca.MX]
) -> tuple[ca.MX, ca.MX]:
    """Return the tensions of a Newton step, and how many tendons are on the wrong side there."""
    (T, lengths, J), (left, soft, held) = at, given
    M, lacks = ca.diag(soft) - J, left + soft * T - lengths
    off, own = ca.norm_inf(held * ca.fmin(lacks, ca.diag(M) * T)), ca.sum1(ca.fabs(ca.diag(M)))
    M += _DAMPED * off / ca.fmax(ca.norm_inf(T) + off / own, _LEAST) * ca.MX.eye(T.numel())
    still = T * (1 - held)
    q = lacks - M @ (T - still)
    taut, wrong = held * (T > 0), ca.MX(0)
    for _ in range(times):
        z, taut, wrong = exchange(M, q, taut, held)
    return still + ca.fmax(z, 0), wrong


@lru_cache(maxsize=8)
def _exchange(n: int) -> ca.Function:
    """Return M, q, taut, held -> z, the taut tendons after an exchange, and how many it changed.

    z (n,) is what w = M z + q = 0 asks of the taut ones, 0 of others.
    """
    M, q = ca.SX.sym("M", n, n), ca.SX.sym("q", n)
    taut, held = ca.SX.sym("taut", n), ca.SX.sym("held", n)
    A = M * (taut @ taut.T) + ca.diag(1 - taut)
    z = _solve(A, -taut * q)
    w = M @ z + q
    slackens = z < -_TINY * ca.norm_inf(z)
    tightens = w < -_TINY * ca.norm_inf(q)
    wrong = held * ca.if_else(taut, slackens, tightens)
    after = ca.if_else(wrong, 1 - taut, taut)
    return ca.Function("exchange", [M, q, taut, held], [z, after, ca.sum1(wrong)], {"cse": True})


def _solve(A: ca.SX, right: ca.SX) -> ca.SX:
    """Return A^-1 right (n,), A (n, n) nearly positive definite, by elimination without pivots."""
    n = right.numel()
    rows, x = [ca.horzsplit(row) for row in ca.vertsplit(A)], ca.vertsplit(right)
    for k in range(n):
        for i in range(k + 1, n):
            share = rows[i][k] / rows[k][k]
            rows[i] = [
                *rows[i][: k + 1],
                *(a - share * b for a, b in zip(rows[i][k + 1 :], rows[k][k + 1 :], strict=True)),
            ]
            x[i] = x[i] - share * x[k]
    for k in reversed(range(n)):
        x[k] = (x[k] - sum((rows[k][j] * x[j] for j in range(k + 1, n)), ca.SX(0))) / rows[k][k]
    return ca.vertcat(*x)
