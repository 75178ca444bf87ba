"""Whether an arm stands that leans on things: its energy's Hessian where what touches stays shut.

Of the directions in which the arm can move with its contacts: with these as equations the inverse
of the Jacobian, in the strains, is that of the Hessian there, and 0 across. So the eigenvalues of
this inverse are the reciprocals of the Hessian's, and 0. See model.equilibrium.stability for the
scale.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import rest_stiffness
from model.errors import SingularError
from model.paths import Array

# Reciprocal eigenvalues between these are rounding, and the 0 of contacts.
_NONE = 1e-4
_BASIS, _SETTLED, _RESTARTS = 32, 1e-2, 30


def held_stands(here: Linearised) -> bool:
    """Return whether an equilibrium is stable while what touches stays shut."""
    try:
        return _extreme(here, "SR") > -_NONE
    except SingularError:
        return False


def held_stability(here: Linearised) -> float:
    """Return the least eigenvalue of the scaled Hessian; below 0 it does not stand.

    Of a Hessian that is not symmetric the least real part. 0 where the arm is about to give way.
    """
    try:
        low = _extreme(here, "SR", 1e-8)
        return float(1 / (low if low < -_NONE else _extreme(here, "LR", 1e-8)))
    except SingularError:
        return 0.0


def _extreme(here: Linearised, which: Literal["SR", "LR"], tol: float = _SETTLED) -> float:
    """Return the least or largest eigenvalue of the Hessian's inverse, by Arnoldi's method."""
    of = here.system.of
    places, n = np.ravel(of.stages), of.stages.size
    weight, stiff = rest_stiffness(here.system)
    before, after = np.sqrt(stiff / weight), np.sqrt(weight * stiff)

    def inverse(bends: Array) -> Array:
        right = np.zeros(of.n_states)
        right[places] = before * np.ravel(bends)
        return after * here.solve(right)[places]

    start = np.random.default_rng(0).standard_normal(n)
    operator = LinearOperator((n, n), matvec=inverse, dtype=float)
    given = {
        "which": which,
        "v0": start,
        "ncv": min(_BASIS, n - 1),
        "tol": tol,
        "maxiter": _RESTARTS,
    }
    try:
        found = eigs(operator, 1, return_eigenvectors=False, **given)
    except ArpackNoConvergence:  # as where many eigenvalues are one
        unit = np.zeros((of.n_states, n), order="F")
        unit[places, np.arange(n)] = before
        found = np.linalg.eigvals(after[:, None] * here.solve(unit)[places])
    return float(found.real.min() if which == "SR" else found.real.max())
