"""The quadratic program of a step, and multipliers at a point."""

from __future__ import annotations

import numpy as np
import scipy

from model.paths import Array
from planner.contact.program import NEAREST, Optimum, Program
from planner.contact.settled_terms import SettledTerms
from planner.solve.quadratic import quadratic

# Margins and limits that may hold: below this share of the arm's length, or of the unit.
ACTIVE = 1e-7
# Curvature of what cannot be met, beside its cost in proportion; steps stay so far inside of a
# piece.
_CURVED, _ASIDE = 1.0, 1e-9

# The least curvature of a step, over the largest, so that rounding does not tell where it ends.
_LEAST = 1e-7
# What constraints may be missed by: it costs the penalty in proportion.
_MISSED = 1e-11

# Of tensions, equality and inequality, scaled.
Multipliers = tuple[Array, Array, Array]


def quadratic_step(
    program: Program, here: SettledTerms, B: Array, penalty: float, region: float
) -> tuple[Array, Multipliers]:
    """Return a step of the scaled unknowns (n,), and multipliers of bounds and constraints.

    What cannot be met costs in proportion (an exact penalty). Source: Nocedal and Wright,
    "Numerical Optimization" (2006), 18.5.
    """
    A, C = program.rows(here, "equality"), program.rows(here, "inequality")
    c, d = here.values["equality"], here.values["inequality"]
    near = program.rows(here, "soft_residual")
    n, m, k = B.shape[0], c.size, d.size
    size = n + 2 * m + k
    H = _CURVED * np.eye(size)
    H[:n, :n] = B + NEAREST * near.T @ near
    H[:n, :n] += _LEAST * np.diag(B).max() * np.eye(n)
    g = np.concatenate([program.gradient(here), np.full(size - n, penalty)])
    rows = np.zeros((m + k + 1, size))
    rows[:m, :n], rows[:m, n : n + m], rows[:m, n + m : n + 2 * m] = A, np.eye(m), -np.eye(m)
    rows[m : m + k, :n], rows[m : m + k, n + 2 * m :] = C, np.eye(k)
    rows[-1, :n] = program.sums(here)
    aside = np.zeros(k)
    aside[here.inequalities :] = np.clip(d[here.inequalities :], 0.0, _ASIDE)
    low = np.concatenate([-c, aside - d, [-np.inf]])
    left = (program.total - here.tensions.sum()) / program.units.max()
    high = np.concatenate([-c, np.full(k, np.inf), [left]])
    down, up = program.room(here)
    lbx = np.concatenate([np.maximum(down, -region), np.zeros(size - n)])
    ubx = np.concatenate([np.minimum(up, region), np.full(size - n, np.inf)])
    solve = quadratic(size, len(rows), _MISSED)
    solved = solve(H.ravel(), g, rows.ravel("F"), low, high, lbx, ubx)
    x, _, lam_a, lam_x = (own.ravel() for own in solved)
    free = (x[:n] > -region * (1 - 1e-9)) & (x[:n] < region * (1 - 1e-9))
    return x[:n], (np.where(free, lam_x[:n], 0.0), lam_a[:m], lam_a[m : m + k])


def optimum_at(program: Program, here: SettledTerms) -> Optimum:
    """Return where the program is, with the multipliers that leave least of its gradient."""
    g, T = program.gradient(here), here.tensions
    active, near = np.flatnonzero(here.values["inequality"] <= ACTIVE), ACTIVE * program.units
    low, high = np.flatnonzero(program.lower + near >= T), np.flatnonzero(program.upper - near <= T)
    full = int(T.sum() >= program.total - near.max())
    A, C, unit = (
        program.rows(here, "equality"),
        program.rows(here, "inequality")[active],
        np.eye(g.size),
    )
    rows = np.vstack([A, -C, -unit[low], unit[high], program.sums(here)[:full]])
    least = np.concatenate([np.full(len(A), -np.inf), np.zeros(len(rows) - len(A))])
    lam = np.zeros(len(rows))
    if rows.size:
        # Without bounds ahead its steps are 0 times infinity, which it does not take.
        with np.errstate(invalid="ignore"):
            lam = scipy.optimize.lsq_linear(rows.T, -g, (least, np.inf)).x
    left = float(np.abs(g + rows.T @ lam).max()) / (1 + float(np.abs(lam).max(initial=0.0)))
    equality, inequality, bounds = (
        lam[: len(A)],
        np.zeros(here.values["inequality"].size),
        np.zeros(T.size),
    )
    ends = np.cumsum([len(A), active.size, low.size, high.size])
    inequality[active] = -lam[ends[0] : ends[1]]
    bounds[low] -= lam[ends[1] : ends[2]]
    bounds[high] += lam[ends[2] : ends[3]]
    return Optimum(here, bounds, equality, inequality, left)
