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


def unstable_mode(here: Linearised) -> Array | None:
    """Return the strains of the least stable mode (N stages, strains), that rotate by some 1 rad.

    None where an equilibrium is stable with its contacts closed, or about to buckle.
    """
    try:
        value, vector = _extreme(here, "SR", _ROUGH)
    except SingularError:
        return None
    if value > -_NONE:
        return None
    of, (weight, stiff) = here.system.of, rest_stiffness(here.system)
    mode = (vector / np.sqrt(weight * stiff)).reshape(of.stages.shape)
    bends = mode[:, : 2 + of.form.law.torsion]
    turns = weight.reshape(mode.shape)[:, :1] * np.abs(bends)
    return np.asarray(mode / turns.sum(axis=0).max())


def held_stability(here: Linearised) -> float:
    """Return the least eigenvalue of the scaled Hessian; below 0 it is unstable.

    Of a Hessian that is not symmetric the least real part. 0 where the arm is about to buckle.
    """
    try:
        low, _ = _extreme(here, "SR")
        return 1 / (low if low < -_NONE else _extreme(here, "LR")[0])
    except SingularError:
        return 0.0


def _extreme(
    here: Linearised, which: Literal["SR", "LR"], tol: float = 1e-8
) -> tuple[float, Array]:
    """Return the least or largest eigenvalue of the inverse of the scaled Hessian, its vector (n,).

    By Arnoldi's method.
    """
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
    options = {"v0": start, "ncv": min(_BASIS, n - 1), "tol": tol, "maxiter": _RESTARTS}
    try:
        values, vectors = eigs(operator, 1, which=which, **options)
    except ArpackNoConvergence:  # as where many eigenvalues are one
        values, vectors = np.linalg.eig(inverse(np.eye(n)))
    k = int(np.argmin(values.real) if which == "SR" else np.argmax(values.real))
    return float(values[k].real), vectors[:, k].real
