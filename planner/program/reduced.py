"""A program linearised at some unknowns, reduced to those before the states.

With c = 0 the equations of equilibrium, S the states and a what comes before them, a change of a
moves the states by z + Z da with z = -c_S^-1 c and Z = -c_S^-1 c_a, so that

    gradient = f_a + Z^T f_S        Jacobian = g_a + g_S Z        Hessian = (1, Z)^T H (1, Z)

where H is the Hessian of f + lam . g + mu . c with the multipliers mu = -c_S^-T (f_S + g_S^T lam):
the implicit function theorem, first and second order, exact in equilibrium, where z = 0. Near it
the constraints are g + g_S z to first order, and a quadratic model's slope has (1, Z)^T H (0, z)
more. Source: Albersmeyer, Diehl, "The lifted Newton method and its application in optimization",
SIAM J. Optim. 20 (2010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dgemv
from scipy.sparse import csc_array

from model.paths import Array

Index = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Reduced:
    """Values and first derivatives at unknowns x.

    Attributes
    ----------
    x : (size,)
        All unknowns.
    f : float
    gradient : (n,)
    g : (m,)
        Constraints besides equilibrium, to first order where the states settle.
    jacobian : (m, n)
    states : States or None
        What was eliminated, if anything was.
    """

    x: Array
    f: float
    gradient: Array
    g: Array
    jacobian: Array
    states: Eliminated | None = None

    @property
    def off(self) -> float:
        """The largest of what the states lack to equilibrium, to first order."""
        return 0.0 if self.states is None else float(np.abs(self.states.shift).max())


@dataclass(frozen=True, eq=False)
class Eliminated:
    """How the states follow, at a point.

    Attributes
    ----------
    moves : (size - n, n + 1)
        Z, how they move with the unknowns before them, and z, what they lack to equilibrium.
    slopes : (m + 1, size - n)
        Derivatives of constraints and, last, of the objective by the states.
    solve : right-hand side, transposed -> solution of systems with c_S
    """

    moves: Array
    slopes: Array
    solve: Callable[[Array, bool], Array]

    @property
    def shift(self) -> Array:
        """What the states lack to equilibrium, z (size - n,)."""
        return self.moves[:, -1]

    def moved(self) -> Array:
        """Return what the states add (m + 1, n + 1) to derivatives and, last, values."""
        return np.asarray(dgemm(1.0, self.slopes, self.moves))

    def following(self, change: Array) -> Array:
        """Return how the states move, to first order, to equilibrium after a change (n,)."""
        return np.asarray(dgemv(1.0, self.moves[:, :-1], change, beta=1.0, y=self.shift))

    def multipliers(self, sigma: float, lam: Array) -> Array:
        """Return the multipliers mu of equilibrium; the load factor, which stays, has none."""
        weighted = dgemv(1.0, self.slopes, np.append(lam, sigma), trans=1)
        return -self.solve(weighted[1:], True)

    def hessian(self, H: Curvature) -> tuple[Array, Array]:
        """Return (1, Z)^T H (1, Z), (n, n), and (1, Z)^T H (0, z), (n,), of H."""
        n = self.moves.shape[1] - 1
        moved = np.vstack([np.eye(n, n + 1), self.moves])
        found = dgemm(1.0, (H @ moved).T, moved.T[:n], trans_b=True).T
        return found[:, :n], found[:, n]


@dataclass(frozen=True, eq=False)
class Nonzeros:
    """Where the nonzeros of a matrix are, column by column."""

    rows: Index
    columns: Index
    ends: Index
    shape: tuple[int, int]

    @classmethod
    def of(cls, places: ca.Sparsity) -> Nonzeros:
        """Return those of CasADi's."""
        rows, columns, ends = (
            np.array(own, dtype=np.int32)
            for own in (places.row(), places.get_col(), places.colind())
        )
        return cls(rows, columns, ends, places.shape)

    def matrix(self, nonzeros: Array) -> csc_array:
        """Return the matrix."""
        return csc_array((nonzeros, self.rows, self.ends), shape=self.shape)


@dataclass(frozen=True, eq=False)
class Curvature:
    """The Hessian of a Lagrangian in scaled unknowns: outer + D inner D, D = diag(scale).

    Attributes
    ----------
    outer, inner : (size, size)
        Of objective and constraints, and of the equations of equilibrium in their own unknowns.
    scale : (size,)
    """

    outer: csc_array
    inner: csc_array
    scale: Array

    def __matmul__(self, columns: Array) -> Array:
        """Return the product with columns (size, k)."""
        scale = self.scale[:, None]
        return np.asarray(self.outer @ columns + scale * (self.inner @ (scale * columns)))

    def toarray(self) -> Array:
        """Return the whole matrix."""
        return np.asarray(self @ np.eye(self.scale.size))
