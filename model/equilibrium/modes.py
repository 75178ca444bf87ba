"""The stability of an equilibrium as a number: least eigenvalues, their modes and derivatives.

See octoplan.model.equilibrium.stability for the matrix and its scaling.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.stability import (
    is_stable,
    rest_stiffness,
    stiffness_at_rest,
    with_shift,
)
from octoplan.model.loads import is_conservative, is_coupled
from octoplan.model.paths import Array
from octoplan.model.support.errors import SingularError

# Number of Arnoldi vectors per eigenvalue that is computed.
_VECTORS = 40
# Number of restarts of Arnoldi's method.
_RESTARTS = 10
# Tolerance of an eigenvalue without a mode: the error is squared if the Hessian is symmetric.
_VALUE_TOL = 1e-8
# Tolerance of an eigenvalue of which only the sign is used.
_SIGN_TOL = 1e-2
# Reciprocals of eigenvalues above minus this are no instability: rounding, or 0 of contacts.
_SIGN_MARGIN = 1e-4
# Reciprocals below this, relative to the largest one, are rounding, or 0 of contacts.
_RECIPROCAL_ROUNDING = 1e-12
# Number of further eigenvalues if eigenvalues may be complex: the eigenvalue nearest to
# the shift need not have the least real part.
_FURTHER = 8
# Imaginary parts up to this, relative to the eigenvalue, are rounding.
_REAL_TOL = 1e-9
# Lowest shift; lower eigenvalues are not computed.
_LOWEST_SHIFT = -1e6


def stability(point: Equilibrium) -> float:
    """Return the least eigenvalue of the scaled Hessian of the energy; an arm is stable above 0.

    In contact, only motions with constant contacts count. If the Hessian is unsymmetric, return the
    least real part. Then only the sign may be certain: without NeoHookean the eigenvalues amplify
    rounding by 1e13. Return 0 if the equations are singular.
    """
    if not is_coupled(point.system.arm, point.system.scene):
        # Each cross-section has its own Hessian, because no wrench couples the cross-sections.
        sections = point.system.sections
        v = point.states[point.system.layout.stages]
        jacobian = sections.balance(v, point.tensions[sections.tendon]).jacobian
        root = np.sqrt(stiffness_at_rest(sections.law, sections.body).T)
        scaled = jacobian / root[:, :, None] / root[:, None, :]
        return float(np.linalg.eigvals(scaled).real.min())
    try:
        return float(_least(point, 1, tolerance=_VALUE_TOL)[0][0].real)
    except (SingularError, np.linalg.LinAlgError):
        return 0.0


def least_modes(point: Equilibrium, count: int) -> tuple[Array, Array]:
    """Return the least eigenvalues (count,), and the changes of the states (n_states, count).

    A mode is a change y of the states with J y = lambda B y, where J is the Jacobian of the
    equilibrium and B is the stiffness of the body at rest, at the stages. For complex eigenvalues
    return the real parts. Raise SingularError if the equations are singular.
    """
    values, bends, shifted = _least(point, count)
    return values.real, _spread(shifted, (bends * values).real)


def _spread(point: Equilibrium, bends: Array, transposed: bool = False) -> Array:
    """Return the changes of the states (n_states, count) in modes (n, count) at the stages."""
    layout = point.system.layout
    right = np.zeros((layout.n_states, bends.shape[1]), bends.dtype)
    right[np.ravel(layout.stages)] = rest_stiffness(point.system)[1][:, None] * bends
    if np.isrealobj(right):
        return point.solve(right, transposed)
    parts = [point.solve(np.ascontiguousarray(x), transposed) for x in (right.real, right.imag)]
    return np.asarray(parts[0] + 1j * parts[1])


def unstable_mode(point: Equilibrium) -> Array | None:
    """Return the strains (N stages, strains) of the least stable mode, with rotations up to 1 rad.

    Return None if the equilibrium is stable at constant contacts, or if the equations are singular.
    """
    if point.factor is None:
        return None
    values, bends = _reciprocals(point, (1, 1), "SR", _SIGN_TOL)
    least = int(np.argmin(values.real))
    if values[least].real > -_SIGN_MARGIN:
        return None
    layout = point.system.layout
    weight, _ = rest_stiffness(point.system)
    mode = bends[:, least].real.reshape(layout.stages.shape)
    curvatures = np.abs(mode[:, : 2 + layout.structure.law.torsion])
    rotations = weight.reshape(mode.shape)[:, :1] * curvatures
    return np.asarray(mode / rotations.sum(axis=0).max())


def stability_slope(point: Equilibrium) -> tuple[float, Array]:
    """Return the stability, and its derivatives by the tensions (n_tendons,) [1/N].

    Let y be a mode of J, J y = lambda B y, and w a mode of its transpose. The derivative of lambda
    is w . dJ y / (w . B y), where dJ is the change of the Jacobian with tensions and states. Both
    modes may be complex if loads have no potential. Raise SingularError if the equations are
    singular.
    """
    layout = point.system.layout
    weight, stiff = rest_stiffness(point.system)
    (value,), bends, shifted = _least(point, 1)
    if abs(value.imag) <= _REAL_TOL * abs(value):
        # Inverse iteration from y: of a double eigenvalue of a symmetric Hessian, w is y.
        near = with_shift(point, value.real - np.spacing(1e4))
        w = _spread(near, weight[:, None] * bends.real, transposed=True)
    else:
        (other,), left, _ = _least(point, 1, transposed=True)
        is_conjugate = value.imag * other.imag < 0
        w = _spread(shifted, left.conj() if is_conjugate else left, transposed=True)
    y = _spread(shifted, bends)[:, 0]
    w = w[:, 0]
    places = np.ravel(layout.stages)
    rows, columns = layout.equations.hessian.triplet
    H = layout.equations.hessian(point.x, point.system.p, w.real)
    if np.iscomplexobj(w):
        H = H + 1j * layout.equations.hessian(point.x, point.system.p, w.imag)
    mode = np.append(np.zeros(layout.n_before_states), y)
    tensions = np.eye(layout.n_before_states, layout.n_tendons)
    by_unknowns = np.vstack([tensions, point.by_tensions])
    slope = (mode[rows] * H) @ by_unknowns[columns]
    return float(value.real), (slope / (w[places] @ (stiff * y[places]))).real


def _least(
    point: Equilibrium, count: int, transposed: bool = False, tolerance: float = 0.0
) -> tuple[Array, Array, Equilibrium]:
    """Return the least eigenvalues, their modes at the stages (n, count), and the shifted system.

    Shift-and-invert: the shift lies below all eigenvalues. If loads have no potential, eigenvalues
    may be complex, and further eigenvalues are computed as far as they converge: most of them are
    near 1. With `transposed`, return the modes of the transposed matrix.
    """
    further = 0 if is_conservative(point.system.scene) else _FURTHER
    if further and point.linearised_at:
        # Eigenvalues of an unsymmetric matrix may amplify any error of the Jacobian.
        point = Equilibrium(point.system, point.x)
    shift = 0.0
    shifted = point
    while not is_stable(shifted) and shift > _LOWEST_SHIFT:
        shift = min(4 * shift, -1.0)
        shifted = with_shift(point, shift)
    values, bends = _reciprocals(shifted, (count, count + further), "LM", tolerance, transposed)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_finite = np.abs(values) > _RECIPROCAL_ROUNDING * np.abs(values).max()
        values = np.where(is_finite, 1 / values, np.inf)
    least = np.argsort(values.real)[:count]
    return values[least] + shift, bends[:, least], shifted


def _reciprocals(
    point: Equilibrium,
    counts: tuple[int, int],
    which: Literal["LM", "SR"],
    tolerance: float,
    transposed: bool = False,
) -> tuple[Array, Array]:
    """Return reciprocals of eigenvalues, and their modes at the stages (n, .).

    Arnoldi's method is applied to the inverse of the equations. If too few reciprocals converge,
    all eigenvalues are computed. With contacts as equations, the operator is the inverse of the
    Hessian in the directions in which the arm can move, and 0 across.

    Parameters
    ----------
    counts : (int, int)
        The number of reciprocals that must converge, and the number that is computed.
    which : "LM" or "SR"
        Largest magnitude, or smallest real part.
    """
    layout = point.system.layout
    weight, stiff = rest_stiffness(point.system)
    places = np.ravel(layout.stages)
    before = np.sqrt(stiff / weight)
    after = np.sqrt(weight * stiff)

    def inverse(bends: Array) -> Array:
        right = np.zeros((layout.n_states, *bends.shape[1:]))
        right[places] = (before * bends.T).T
        return np.asarray((after * point.solve(right, transposed)[places].T).T)

    n = stiff.size
    operator = LinearOperator((n, n), matvec=inverse)
    v0 = np.random.default_rng(0).standard_normal(n)
    required, computed = counts
    # Try more vectors and restarts before the whole matrix, which is large on fine meshes. With as
    # many vectors as rows the whole matrix is faster.
    for factor in (1, 4):
        width = factor * _VECTORS * computed
        if width >= n:
            break
        size = {"ncv": width, "maxiter": factor * _RESTARTS, "v0": v0}
        try:
            values, vectors = eigs(operator, computed, which=which, tol=tolerance, **size)
        except ArpackNoConvergence as part:
            values = part.eigenvalues
            vectors = part.eigenvectors
        if values.size >= required:
            return values, (vectors.T / after).T
    values, vectors = np.linalg.eig(inverse(np.eye(n)))
    return values, (vectors.T / after).T
