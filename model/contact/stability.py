"""Whether an arm in contact stands: its energy's Hessian where what touches stays shut.

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
        return _Inverse(here).extreme("SR")[0] > -_NONE
    except SingularError:
        return False


def held_stability(here: Linearised) -> float:
    """Return the least eigenvalue of the scaled Hessian; below 0 it does not stand.

    Of a Hessian that is not symmetric the least real part. 0 where the arm is about to buckle.
    """
    try:
        inverse = _Inverse(here)
        low = inverse.extreme("SR", 1e-8)[0]
        return 1 / (low if low < -_NONE else inverse.extreme("LR", 1e-8)[0])
    except SingularError:
        return 0.0


class _Inverse:
    """The inverse of the scaled Hessian, by the equations' factors."""

    def __init__(self, here: Linearised) -> None:
        self.here, of = here, here.system.of
        self.places, self.n = np.ravel(of.stages), of.stages.size
        weight, stiff = rest_stiffness(here.system)
        self.before, self.after = np.sqrt(stiff / weight), np.sqrt(weight * stiff)

    def times(self, bends: Array) -> Array:
        """Return it times changes of the strains (n,)."""
        right = np.zeros(self.here.system.of.n_states)
        right[self.places] = self.before * np.ravel(bends)
        return np.asarray(self.after * self.here.solve(right)[self.places])

    def extreme(self, which: Literal["SR", "LR"], tol: float = _SETTLED) -> tuple[float, Array]:
        """Return the least or largest eigenvalue, and its vector (n,), by Arnoldi's method."""
        operator = LinearOperator((self.n, self.n), matvec=self.times, dtype=float)
        start = np.random.default_rng(0).standard_normal(self.n)
        given = {"v0": start, "ncv": min(_BASIS, self.n - 1), "tol": tol, "maxiter": _RESTARTS}
        try:
            values, vectors = eigs(operator, 1, which=which, **given)
        except ArpackNoConvergence:  # as where many eigenvalues are one
            values, vectors = np.linalg.eig(self._dense())
        at = int(np.argmin(values.real) if which == "SR" else np.argmax(values.real))
        return float(values[at].real), vectors[:, at].real

    def _dense(self) -> Array:
        unit = np.zeros((self.here.system.of.n_states, self.n), order="F")
        unit[self.places, np.arange(self.n)] = self.before
        return np.asarray(self.after[:, None] * self.here.solve(unit)[self.places])
