"""The conic program of a tracking step: least effort within limits at, or nearest to, the target.

A quadratic model (octoplan.planner.extensions.tracking.quadratic) of the program is minimised over
changes da of the decisions within limits,

    exact      min  1/2 da . H da + g . da                         with the target rows,
    nearest    min  1/2 da . H da + g . da + rho |miss| + rho_limits t,

and `nearest` is solved if `exact` has no solution. The misses are the linearised violations of the
target rows times their weights; t is the largest violation of a limit. rho is an exact penalty of
the misses. rho_limits is larger, so that limits have priority. With the Jacobian E of the
equalities, H + sigma E^T E has the same minimum if the equalities hold; in `nearest`, sigma is a
quadratic penalty of their violations beside rho. Negative eigenvalues of H + sigma E^T E, which
exist far from a local optimum, are replaced by their absolute values.

Source: Fletcher, "Practical Methods of Optimization", Wiley (1987), section 14.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import clarabel
import numpy as np

from octoplan.model.equilibrium.linearised import Index
from octoplan.model.paths import Array
from octoplan.planner.extensions.conic import Cone, conic_program
from octoplan.planner.extensions.tracking.quadratic import QuadraticModel

# rho: cost of a distance of one arm's length from the target, over the effort [-].
MISS_COST = 1e4
# rho_limits: cost of the violation of a limit by one arm's length, over the effort [-].
_LIMIT_COST = 100 * MISS_COST
# sigma: curvature of the objective along the target rows, over the effort [-].
_CURVATURE = 1e3
# Smallest eigenvalue of the Hessian of the effort, over the effort [-].
_LEAST_EIGENVALUE = 1e-8
# Largest violation of a row by the solution of a conic program [-].
_ROW_TOL = 1e-8


class LinearRows(NamedTuple):
    """Rows with bounds: lower <= values + jacobian da <= upper.

    Attributes
    ----------
    values, lower, upper : (k,)
    jacobian : (k, n)
    """

    values: Array
    jacobian: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class StepSolution:
    """The solution of a StepProgram.

    Attributes
    ----------
    change : (n,)
        Change of the decisions.
    rows : (m,)
        Multipliers of the design rows, with CasADi's signs: positive at an upper bound.
    limits : (k,)
        Multipliers of the further limits.
    bounds : (n,)
        Multipliers of the bounds of the changes.
    miss : float
        Weighted norm of the misses; 0 if the target is met.
    """

    change: Array
    rows: Array
    limits: Array
    bounds: Array
    miss: float


@dataclass(frozen=True, eq=False)
class StepProgram:
    """The conic program of a step.

    Attributes
    ----------
    model : QuadraticModel
    effort : float
        Unit of the objective.
    lower, upper : (n,)
        Bounds of the change of each decision.
    row_bounds : (m,), (m,)
        Lower and upper bounds of the design rows.
    weights : (m,)
        Weights of the misses of target rows; 0 for rows of limits.
    limits : LinearRows
        Further limits, of stability and of rates.
    """

    model: QuadraticModel
    effort: float
    lower: Array
    upper: Array
    row_bounds: tuple[Array, Array]
    weights: Array
    limits: LinearRows

    def solve(self) -> StepSolution | None:
        """Return the solution of `exact`, otherwise of `nearest`; None if the solver fails."""
        free = np.flatnonzero(self.upper > self.lower)
        n = free.size
        rows = self._rows(free)
        E, c = rows.equalities
        H = _convex(self.model.hessian[np.ix_(free, free)] / self.effort, E)
        cost = self.model.gradient[free] / self.effort + _CURVATURE * c @ E
        room = np.append(-self.lower[free], self.upper[free])
        is_bound = np.isfinite(room)
        bounds = np.vstack([np.eye(n), -np.eye(n)])[is_bound], room[is_bound]
        solved = _exact(H, cost, bounds, rows) or _nearest(H, cost, bounds, rows)
        if solved is None:
            return None
        da, of_bounds, of_rows, miss = solved
        da = np.clip(da, self.lower[free], self.upper[free])
        # sigma is a part of the multipliers of the equalities.
        of_rows[: c.size] -= _CURVATURE * (E @ da + c)
        m = self.weights.size
        lam = np.zeros(m + self.limits.values.size)
        np.add.at(lam, rows.numbers, -self.effort * rows.signs * of_rows)
        change = np.zeros(self.lower.size)
        change[free] = da
        both = np.zeros(2 * n)
        both[is_bound] = self.effort * of_bounds
        at_bounds = np.zeros(self.lower.size)
        at_bounds[free] = both[n:] - both[:n]
        return StepSolution(change, lam[:m], lam[m:], at_bounds, miss)

    def _rows(self, free: Index) -> _ConicRows:
        """Return the rows of the program for the decisions that can change."""
        values = np.append(self.model.rows, self.limits.values)
        jacobian = np.vstack([self.model.jacobian, self.limits.jacobian])[:, free]
        lower = np.append(self.row_bounds[0], self.limits.lower)
        upper = np.append(self.row_bounds[1], self.limits.upper)
        equal = np.flatnonzero(lower == upper)
        low = np.flatnonzero(np.isfinite(lower) & (lower < upper))
        high = np.flatnonzero(np.isfinite(upper) & (lower < upper))
        numbers = np.concatenate([equal, low, high])
        signs = np.repeat([1.0, 1.0, -1.0], [equal.size, low.size, high.size])
        bound = np.where(signs > 0, lower[numbers], upper[numbers])
        return _ConicRows(
            numbers,
            signs,
            signs[:, None] * jacobian[numbers],
            signs * (values[numbers] - bound),
            np.append(self.weights, np.zeros(self.limits.values.size))[numbers],
            equal.size,
        )


class _ConicRows(NamedTuple):
    """Rows A da + b, equalities = 0 before inequalities >= 0.

    Attributes
    ----------
    numbers : (k,)
        Number of each row among the design rows and the further limits.
    signs : (k,)
        -1 for upper bounds, otherwise 1.
    A, b : (k, n), (k,)
    weights : (k,)
        Weights of misses; 0 for limits.
    n_equal : int
        Number of equalities.
    """

    numbers: Index
    signs: Array
    A: Array
    b: Array
    weights: Array
    n_equal: int

    @property
    def equalities(self) -> tuple[Array, Array]:
        """Jacobian and values of the equalities."""
        return self.A[: self.n_equal], self.b[: self.n_equal]

    @property
    def inequalities(self) -> tuple[Array, Array]:
        """Jacobian and values of the inequalities."""
        return self.A[self.n_equal :], self.b[self.n_equal :]


# Changes of the decisions, multipliers of their bounds and of the rows, norm of the misses.
_Solved = tuple[Array, Array, Array, float]


def _exact(H: Array, cost: Array, bounds: tuple[Array, Array], rows: _ConicRows) -> _Solved | None:
    """Return the solution with target rows; None if there is none."""
    cones: list[Cone] = [
        (clarabel.NonnegativeConeT, *bounds),
        (clarabel.ZeroConeT, *rows.equalities),
        (clarabel.NonnegativeConeT, *rows.inequalities),
    ]
    solved = conic_program(H, cost, cones)
    if solved is None:
        return None
    da, multipliers = solved
    values = rows.A @ da + rows.b
    values[: rows.n_equal] = -np.abs(values[: rows.n_equal])
    if values.min(initial=0.0) < -_ROW_TOL:
        return None
    n_bounds = bounds[1].size
    return da, multipliers[:n_bounds], multipliers[n_bounds:], 0.0


def _nearest(
    H: Array, cost: Array, bounds: tuple[Array, Array], rows: _ConicRows
) -> _Solved | None:
    """Return the solution with penalties of misses and of violated limits.

    The variables are da (n,), slacks (k,) of the inequalities among the target rows, t and |miss|.
    """
    n = cost.size
    E, c = rows.equalities
    A, b = rows.inequalities
    w = rows.weights[: rows.n_equal]
    soft_weights = rows.weights[rows.n_equal :]
    soft = np.flatnonzero(soft_weights > 0)
    k = soft.size
    size = n + k + 2
    t, miss = n + k, n + k + 1
    hessian = np.zeros((size, size))
    hessian[:n, :n] = H
    costs = np.concatenate([cost, np.zeros(k), [_LIMIT_COST, MISS_COST]])
    inequalities = np.hstack([A, np.zeros((b.size, k + 2))])
    inequalities[soft, n + np.arange(k)] = 1.0
    inequalities[soft_weights == 0, t] = 1.0
    misses = np.zeros((1 + c.size + k, size))
    misses[0, miss] = 1.0
    misses[1 : 1 + c.size, :n] = w[:, None] * E
    misses[1 + c.size + np.arange(k), n + np.arange(k)] = soft_weights[soft]
    slacks = np.eye(k + 1, size, n)
    wider = np.hstack([bounds[0], np.zeros((bounds[1].size, k + 2))])
    cones: list[Cone] = [
        (clarabel.NonnegativeConeT, wider, bounds[1]),
        (clarabel.SecondOrderConeT, misses, np.concatenate([[0.0], w * c, np.zeros(k)])),
        (clarabel.NonnegativeConeT, inequalities, b),
        (clarabel.NonnegativeConeT, slacks, np.zeros(k + 1)),
    ]
    solved = conic_program(hessian, costs, cones)
    if solved is None:
        return None
    z, multipliers = solved
    ends = np.cumsum([bounds[1].size, 1, c.size, k, b.size])
    of_bounds, _, of_equalities, _, of_inequalities, _ = np.split(multipliers, ends)
    return z[:n], of_bounds, np.append(w * of_equalities, of_inequalities), float(z[miss])


def _convex(H: Array, E: Array) -> Array:
    """Return H + sigma E^T E with the absolute values of its eigenvalues."""
    values, vectors = np.linalg.eigh((H + H.T) / 2 + _CURVATURE * E.T @ E)
    return np.asarray((vectors * np.maximum(np.abs(values), _LEAST_EIGENVALUE)) @ vectors.T)
