"""The Hessian of the Lagrangian: by differences within a piece of contact, or by updates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag, null_space

from model.paths import Array
from planner.contact.program import Optimum, Program
from planner.contact.quadratic import ACTIVE, Multipliers
from planner.contact.settled_terms import SettledTerms

# Steps of differences in units of the unknowns, and how far inside of the piece they are taken.
_STEP, _INSIDE = 1e-5, 1e-6
# Least eigenvalue over the largest.
_DEFINITE = 1e-6


def exact_hessian(program: Program, here: SettledTerms, at: Optimum) -> Array | None:
    """Return the Hessian of the Lagrangian, made definite, along what is not held.

    Differences are taken in directions along which the ends of the piece stay as they are, a little
    inside of it, so that all are of one piece. None where the arm does not come there, or stability
    holds it, whose slope is by differences already.
    """
    if program.least and abs(at.lam_inequality[here.inequalities - 1]) > ACTIVE:
        return None
    n, size = here.tensions.size, here.values["inequality"].size
    edges = here.inequalities + np.flatnonzero(
        here.values["inequality"][here.inequalities :] < _INSIDE
    )
    ends = program.rows(here, "inequality")[edges][:, :n]
    inward = np.zeros(n + here.tangential.size)
    inward[:n] = np.linalg.lstsq(ends, np.full(edges.size, _INSIDE), rcond=None)[0]
    still = program.moved(here, inward, clip=False)
    if still is None or still.values["inequality"].size != size:
        return None
    along = block_diag(_across(ends), np.eye(here.tangential.size))
    lam = (at.lam_equality, at.lam_inequality)
    slope, found = lagrangian_gradient(program, still, lam), np.zeros((along.shape[1],) * 2)
    for j, direction in enumerate(along.T):
        there = program.moved(still, _STEP * direction, clip=False)
        if there is None or there.values["inequality"].size != size:
            return None
        found[:, j] = along.T @ (lagrangian_gradient(program, there, lam) - slope) / _STEP
    held = _held_rows(program, here, at)
    free = _across(held @ along)
    values, vectors = np.linalg.eigh(free.T @ (found + found.T) @ free / 2)
    most = max(float(np.abs(values).max(initial=0.0)), 1e-12)
    own = along @ free @ vectors
    found = (own * np.maximum(np.abs(values), _DEFINITE * most)) @ own.T
    return np.asarray(found + max(most, 1.0) * held.T @ held)


def _across(rows: Array) -> Array:
    """Return directions (n, r) across rows (k, n)."""
    return null_space(rows, 1e-9) if rows.size else np.eye(rows.shape[1])


def _held_rows(program: Program, here: SettledTerms, at: Optimum) -> Array:
    """Return the directions (k, n) of scaled unknowns that equations and limits hold."""
    inequalities = program.rows(here, "inequality")[
        np.flatnonzero(np.abs(at.lam_inequality) > ACTIVE)
    ]
    bounds = np.eye(inequalities.shape[1])[np.flatnonzero(at.lam_bounds)]
    rows = np.vstack([program.rows(here, "equality"), inequalities, bounds])
    sizes = np.linalg.norm(rows, axis=1)
    return np.asarray(rows[sizes > 0] / sizes[sizes > 0, None])


def lagrangian_gradient(program: Program, terms: SettledTerms, lam: tuple[Array, Array]) -> Array:
    """Return the gradient by the scaled unknowns of effort and of what multipliers weigh (n,)."""
    own = program.rows(terms, "equality").T @ lam[0] + program.rows(terms, "inequality").T @ lam[1]
    return np.asarray(program.effort_gradient(terms) + own)


def updated(
    program: Program, B: Array, here: SettledTerms, there: SettledTerms, lam: Multipliers
) -> Array:
    """Return the Hessian after a step, Powell's damping keeps it definite; anew in another piece.

    Source: Nocedal and Wright, "Numerical Optimization" (2006), 18.3.
    """
    if there.tangential.size != here.tangential.size:
        return program.effort_hessian(there)
    sizes = {lam[2].size, here.values["inequality"].size, there.values["inequality"].size}
    if len(sizes) > 1:
        lam, here, there = (
            (*lam[:2], lam[2][: here.inequalities]),
            of_targets(here),
            of_targets(there),
        )
    step = np.append(
        (there.tensions - here.tensions) / program.units, there.tangential - here.tangential
    )
    y = lagrangian_gradient(program, there, lam[1:]) - lagrangian_gradient(program, here, lam[1:])
    Bs = B @ step
    curve = float(step @ Bs)
    if curve <= 1e-300:
        return B
    if step @ y < 0.2 * curve:
        share = 0.8 * curve / (curve - float(step @ y))
        y = share * y + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curve + np.outer(y, y) / float(step @ y))


def of_targets(terms: SettledTerms) -> SettledTerms:
    """Return terms without the inequalities of their piece."""
    values = {"inequality": terms.values["inequality"][: terms.inequalities]}
    jacobian = {"inequality": terms.jacobian["inequality"][: terms.inequalities]}
    return replace(terms, values=terms.values | values, jacobian=terms.jacobian | jacobian)
