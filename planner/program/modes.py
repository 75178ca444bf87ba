"""The least stable modes of an arm as unknowns of a program, so that stability is a constraint.

A mode is a change y of the states with J y = lambda B y, J the Jacobian of the equations against
the states and B the stiffness of the body at rest, at the stages; lambda is the eigenvalue of the
scaled Hessian of the energy (model.equilibrium.stability). Its equations are those of equilibrium
differentiated along y, less lambda B y, and the size of y. They have exact derivatives as all
others, and with them the eigenvalue has: stability with a margin is a bound on an unknown.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.equilibrium.stability import rest_stiffness
from model.paths import Array
from model.transcription.kernel import Kernel, Places, mode
from model.transcription.layout import Layout
from model.transcription.system import System
from model.transcription.terms import Term


def mode_terms(of: Layout, place: Places, shift: int, row: int) -> list[Term]:
    """Return the terms of a mode whose unknowns begin at `shift`, and its equations at `row`.

    `place` are the places in the program of the unknowns of the layout.
    """
    terms = []
    for term in of.equations.terms:
        moved = term.unknowns >= of.first
        if not np.all(moved == moved[:, :1]):
            raise AssertionError("tensions and states in one row of a term")
        rows = tuple(np.flatnonzero(moved[:, 0]).tolist())
        change = shift + term.unknowns[list(rows)] - of.first
        kernel = mode(term.kernel, rows)
        terms.append(Term(kernel, np.vstack([place[term.unknowns], change]), row + term.rows))
    stages, last = np.ravel(of.stages), of.n_states
    eigenvalue = np.full(stages.size, shift + last)
    unknowns = np.stack([eigenvalue, shift + stages])
    terms.append(Term(_scaled(), unknowns, row + stages[None, :]))
    size = np.full((1, stages.size), row + last)
    return [*terms, Term(_square(), shift + stages[None, :], size)]


def mode_numbers(at: System, scale: Array) -> list[Array]:
    """Return the numbers (n_c, N) of the last two terms of a mode; `scale` (n,) of the strains."""
    weight, stiff = rest_stiffness(at)
    share = weight / at.arm.length / scale**2
    return [-stiff[None, :], np.stack([share, np.full(share.size, 1 / share.size)])]


def mode_size(at: System, scale: Array, y: Array) -> Array:
    """Return modes (n_states, k) of the size that their equation asks for."""
    weight, _ = rest_stiffness(at)
    strains = y[np.ravel(at.of.stages)] / scale[:, None]
    return np.asarray(y / np.sqrt((weight[:, None] * strains**2).sum(axis=0) / at.arm.length))


@lru_cache(maxsize=1)
def _scaled() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiff = ca.SX.sym("y", 2), ca.SX.sym("stiff")
    return Kernel("inertia", y, stiff, stiff * y[0] * y[1])


@lru_cache(maxsize=1)
def _square() -> Kernel:
    """Return the kernel of a share of a mode's size, less what it has to be."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c", 2)
    return Kernel("size", y, c, c[0] * y**2 - c[1])
