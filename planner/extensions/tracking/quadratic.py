"""Quadratic model of a nonlinear program at an iterate, in the decisions alone.

The equations of equilibrium c(a, S) = 0 of a program determine the states S from the tensions and
the other decisions a. To first order the states change by S_a da + S_0, with

    c_S S_a = -c_a,    c_S S_0 = -c,

so that a step d = V da + v with V = (1, S_a) and v = (0, S_0) satisfies the linearised equations.
The model of the objective f, with the Hessian H of the Lagrangian, and of the design rows C is

    1/2 da . (V^T H V) da + (V^T (f' + H v)) . da,    C + C' V da.

C are the rows at the settled shape under the tensions of the iterate, which the defect of the mesh
brings into the program. The states of the iterate are no equilibrium, so that C' v is no part of
the rows.

Source: Nocedal and Wright, "Numerical Optimization", Springer (2006), section 18.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU

from octoplan.model.paths import Array
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner.program import Program
from octoplan.planner.program_instance import factorised


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Quadratic model of a program in the decisions; see the text of this file.

    Attributes
    ----------
    hessian : (n, n)
        V^T H V.
    gradient : (n,)
        V^T (f' + H v).
    rows : (m,)
        Design rows.
    jacobian : (m, n)
        C' V.
    directions : (size, n + 1)
        Columns of V, then v.
    slopes : (n_equations, n + 1)
        The rows of H (V, v) at the states; f' is added to the last column.
    row_slopes : (m, n_equations)
        Derivatives of the design rows by the states.
    factors : SuperLU
        Of c_S.
    """

    hessian: Array
    gradient: Array
    rows: Array
    jacobian: Array
    directions: Array
    slopes: Array
    row_slopes: Array
    factors: SuperLU

    def step(self, change: Array) -> Array:
        """Return the change of all unknowns (size,) for a change of the decisions (n,)."""
        return np.asarray(self.directions @ np.append(change, 1.0))

    def multipliers(self, change: Array, design: Array) -> Array:
        """Return the multipliers of all rows, from multipliers of the design rows (m,)."""
        slope = self.slopes @ np.append(change, 1.0) + design @ self.row_slopes
        return np.append(design, -self.factors.solve(slope, "T"))


class Linearisation:
    """The map from iterates of a program to quadratic models, without call overhead.

    Sparse matrices are allocated once; one thread at a time may use an instance.
    """

    def __init__(self, program: Program) -> None:
        self._function, jacobian, hessian = _derivatives(program)
        self._n = n = program.n_decision
        self._m = m = program.n_design_rows
        size = program.size
        # Entries of c_S, of c_a and of the design rows among the nonzeros of the Jacobian.
        rows = np.array(jacobian.row())
        columns = np.array(jacobian.get_col())
        is_equation = rows >= m
        self._of_states = np.flatnonzero(is_equation & (columns > n))
        self._of_decisions = np.flatnonzero(is_equation & (columns < n))
        self._of_design = np.flatnonzero(~is_equation)
        self._decision_places = rows[self._of_decisions] - m, columns[self._of_decisions]
        self._design_places = rows[self._of_design], columns[self._of_design]
        places = rows[self._of_states] - m, columns[self._of_states] - n - 1
        n_equations = program.n_equations
        numbers = np.arange(1.0, self._of_states.size + 1)
        self._c_S = csc_array((numbers, places), shape=(n_equations, n_equations))
        self._of_states = self._of_states[self._c_S.data.astype(np.int64) - 1]
        # Both triangles of the Hessian, whose upper triangle the function returns.
        i = np.array(hessian.row())
        j = np.array(hessian.get_col())
        below = np.flatnonzero(i != j)
        source = np.append(np.arange(i.size), below)
        places = np.append(i, j[below]), np.append(j, i[below])
        self._H = csc_array((source + 1.0, places), shape=(size, size))
        self._of_hessian = self._H.data.astype(np.int64) - 1

    def at(self, x: Array, p: Array, multipliers: Array) -> QuadraticModel:
        """Return the model at unknowns x, for parameters p and multipliers of the rows.

        Raise SingularError if the arm buckles.
        """
        n = self._n
        m = self._m
        results = self._function(x, p, np.ones(1), multipliers)
        f, rows, jacobian, hessian = (each.ravel() for each in results)
        self._c_S.data = jacobian[self._of_states]
        self._H.data = hessian[self._of_hessian]
        factors = factorised(self._c_S)
        right = np.zeros((rows.size - m, n + 1))
        right[self._decision_places] = jacobian[self._of_decisions]
        right[:, n] = rows[m:]
        directions = np.zeros((x.size, n + 1))
        directions[:n, :n] = np.eye(n)
        directions[n + 1 :] = -factors.solve(right)
        design = np.zeros((m, x.size))
        design[self._design_places] = jacobian[self._of_design]
        products = self._H @ directions
        reduced = directions.T @ products
        slopes = products[n + 1 :]
        slopes[:, n] += f[n + 1 :]
        return QuadraticModel(
            hessian=reduced[:n, :n],
            gradient=directions[:, :n].T @ f + reduced[:n, n],
            rows=rows[:m],
            jacobian=design @ directions[:, :n],
            directions=directions,
            slopes=slopes,
            row_slopes=design[:, n + 1 :],
            factors=factors,
        )


@lru_cache(maxsize=16)
def _derivatives(program: Program) -> tuple[BufferedFunction, ca.Sparsity, ca.Sparsity]:
    """Return the derivatives of a program, and the sparsity of Jacobian and upper Hessian.

    The function maps unknowns, parameters, 1 and multipliers to the gradient of the objective, the
    rows, and the nonzeros of both matrices.
    """
    at = program.function.mx_in()
    _, gradient, rows, jacobian, hessian = program.function.call(at, True, False)
    results = [ca.densify(each) for each in (gradient, rows, jacobian.nz[:], hessian.nz[:])]
    function = BufferedFunction(ca.Function("derivatives", at, results))
    return function, jacobian.sparsity(), hessian.sparsity()
