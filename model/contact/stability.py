"""Whether an arm in contact is stable: its energy's Hessian with its contacts closed.

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
_BASIS, _ROUGH, _RESTARTS = 32, 1e-2, 30


def held_stands(here: Linearised) -> bool:
    """Return whether an equilibrium is stable with its contacts closed."""
    try:
        return _extreme(here, "SR", _ROUGH) > -_NONE
    except SingularError:
        return False


def held_stability(here: Linearised) -> float:
    """Return the least eigenvalue of the scaled Hessian; below 0 it does not stand.

    Of a Hessian that is not symmetric the least real part. 0 where the arm is about to buckle.
    """
    try:
        low = _extreme(here, "SR")
        return 1 / (low if low < -_NONE else _extreme(here, "LR"))
    except SingularError:
        return 0.0


def _extreme(here: Linearised, which: Literal["SR", "LR"], tol: float = 1e-8) -> float:
    """Return the least or largest eigenvalue of the inverse of the scaled Hessian, by Arnoldi's."""
    of = here.system.of
    stages, n = np.ravel(of.stages), of.stages.size
    weight, stiff = rest_stiffness(here.system)
    before, after = np.sqrt(stiff / weight), np.sqrt(weight * stiff)

    def inverse(bends: Array) -> Array:
        right = np.zeros((of.n_states, *bends.shape[1:]), order="F")
        right[stages] = (before * bends.T).T
        return np.asarray((after * here.solve(right)[stages].T).T)

    operator = LinearOperator((n, n), matvec=inverse, dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    given = {"v0": start, "ncv": min(_BASIS, n - 1), "tol": tol, "maxiter": _RESTARTS}
    try:
        values = eigs(operator, 1, which=which, return_eigenvectors=False, **given)
    except ArpackNoConvergence:  # as where many eigenvalues are one
        values = np.linalg.eigvals(inverse(np.eye(n)))
    return float(values.real.min() if which == "SR" else values.real.max())
