"""Stability of an equilibrium: the Hessian of its potential energy at constant tensions.

Elimination of the node states from the Jacobian of the equilibrium leaves, times the weights of the
stages, the Hessian of the potential energy in the strains. Its eigenvalues are scaled by the
stiffness of the body at rest: 1 for an arm at rest, 1 - P / P_cr for a column under an axial load
P, 0 if the arm buckles. Loads without a potential (followers, currents) and the paper's tangent
make the matrix unsymmetric; then the real parts count, and flutter is not detected. With friction
the tensions along the tendons are constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from octoplan.model.cross_section.law import STIFFNESS_SIZE, CrossSection, components
from octoplan.model.equilibrium.linearised import Equilibrium, Index
from octoplan.model.loads import is_conservative, is_loaded
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.layout import Layout
from octoplan.model.rotations import POSE
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


def is_stable(point: Equilibrium, margin: float = 0.0) -> bool:
    """Return whether the stability of an equilibrium exceeds a margin at constant contacts."""
    return bool(are_stable([_shifted(point, margin) if margin else point])[0])


def are_stable(candidates: Sequence[Equilibrium | None]) -> NDArray[np.bool_]:
    """Return whether equilibria of one system are stable at constant contacts; False for None.

    Without node variables and couplings of nodes, elements are eliminated from tip to base. P_k is
    the stiffness of the part beyond node k against a rotation of the node: 0 at the tip under dead
    loads. S_k is the stiffness of the strains of element k: body, tendons and P_{k+1}. The Hessian
    is positive definite if and only if all S_k are. Source: inertia is additive (Haynsworth, Linear
    Algebra and its Applications 1, 1968).
    """
    stable = np.array([each is not None for each in candidates], dtype=bool)
    points = [each for each in candidates if each is not None]
    if not points:
        return stable
    groups = points[0].system.layout.node_groups
    if any(group.n_variables or group.structure.term.couples_nodes for group in groups):
        stable[stable] = [p.factor is not None and unstable_mode(p) is None for p in points]
        return stable
    stable[stable] = _definite(*_assemble(points))
    return stable


class _ElementBlocks(NamedTuple):
    """Blocks of M equilibria with N elements, by rotations of the nodes and strains.

    w is the number of components of the wrench, n the number of strains of an element. Columns of
    `rotation` and `balance` are the rotation of the first node and the strains of the element.

    Attributes
    ----------
    rotation : (M, N, 3, 3 + n)
        Rotation of the last node.
    balance : (M, N, w + n, 3 + n)
        Balance of the first node and of the stages without the part beyond the element. The rows of
        the stages are multiplied by the stage weights.
    wrench_beyond : (M, N, w + n, w)
        Derivatives of the balance by the wrench of the last node.
    wrench : (M, N, w, w)
        Minus the inverse of the derivatives of the balance of the first node by its wrench.
    """

    rotation: Array
    balance: Array
    wrench_beyond: Array
    wrench: Array


def _assemble(points: Sequence[Equilibrium]) -> tuple[_ElementBlocks, Array]:
    """Return the blocks of the elements, and P (M, w, 3) at the tip."""
    layout = points[0].system.layout
    # The last entry is the value of the place -1.
    nonzeros = np.array([np.append(each.nonzeros, 0.0) for each in points])
    blocks, tip_block = _block_places(layout)
    J = nonzeros.take(blocks, axis=1)
    tip = nonzeros.take(tip_block, axis=1)
    w = layout.structure.n_wrench
    n = layout.structure.stages * layout.structure.n_strains
    basis = rotation_basis(np.array([each.states for each in points])[:, layout.nodes[:, :4]])
    strains = slice(POSE + w, POSE + w + n)
    last = strains.stop
    wrench_beyond = slice(last + POSE, last + POSE + w)
    to_rotation = -4 * basis[:, 1:].swapaxes(2, 3)
    first_rotation = basis[:, :-1]
    quaternion = J[..., w + n : w + n + 4, :]
    by_rotation = to_rotation @ (quaternion[..., :4] @ first_rotation)
    rotation = np.concatenate([by_rotation, to_rotation @ quaternion[..., strains]], axis=3)
    weights = np.repeat(gauss(layout.structure.stages).b, layout.structure.n_strains)
    weighted = J[..., : w + n, :] * np.concatenate([np.ones(w), weights])[:, None]
    balance = np.concatenate([weighted[..., :4] @ first_rotation, weighted[..., strains]], axis=3)
    wrench = -np.linalg.inv(J[..., :w, POSE : POSE + w])
    P = -np.linalg.solve(tip[..., 4:], tip[..., :4]) @ basis[:, -1]
    return _ElementBlocks(rotation, balance, weighted[..., wrench_beyond], wrench), P


def _definite(blocks: _ElementBlocks, P: Array) -> NDArray[np.bool_]:
    """Return whether the Hessians (M,) are positive definite, by P (M, w, 3) at the tip."""
    count, elements, w, _ = blocks.wrench.shape
    remaining = np.arange(count)
    for k in reversed(range(elements)):
        balance = blocks.balance[:, k] + blocks.wrench_beyond[:, k] @ (P @ blocks.rotation[:, k])
        definite = np.array([_is_definite(S) for S in balance[:, w:, 3:]], dtype=bool)
        if not definite.all():
            remaining = remaining[definite]
            balance = balance[definite]
            blocks = _ElementBlocks(*(each[definite] for each in blocks))
        S = balance[:, w:, 3:]
        by_rotation = np.linalg.solve(S, balance[:, w:, :3])
        P = blocks.wrench[:, k] @ (balance[:, :w, :3] - balance[:, :w, 3:] @ by_rotation)
    result = np.zeros(count, dtype=bool)
    # An infinite or undefined entry of any element reaches P at the base.
    result[remaining[np.isfinite(P).all(axis=(1, 2))]] = True
    return result


def _is_definite(S: Array) -> bool:
    """Return whether the real parts of all eigenvalues of a pivot are positive."""
    if not dpotrf(S + S.T)[1]:
        return True
    return bool(np.isfinite(S).all() and (np.linalg.eigvals(S).real > 0).all())


def rotation_basis(q: Array) -> Array:
    """Return the changes (..., 4, 3) of unit quaternions (..., 4) by small turns, base frame."""
    w, x, y, z = np.moveaxis(q / 2, -1, 0)
    rows = [[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@lru_cache(maxsize=16)
def _block_places(layout: Layout) -> tuple[Index, Index]:
    """Return the places of the blocks of the elements and of the tip among the nonzeros.

    The place of a zero entry is -1. Blocks of elements are (N, rows, columns): the rows are the
    wrench at the first node, the balance of the stages and the quaternion at the last node; the
    columns are pose and wrench at the first node, strains, pose and wrench at the last node. The
    rows of the tip are its wrench; the columns are its quaternion and wrench.
    """
    band = layout.band
    w = layout.structure.n_wrench
    shape = (layout.n_states, layout.n_x)
    numbers = np.arange(1, band.rows.size + 1)
    numbered = csr_array((numbers, (band.rows, band.columns)), shape)
    nodes = layout.nodes[:, : POSE + w]
    stages = layout.stages.reshape(layout.elements, -1)
    blocks = []
    for before, inside, after in zip(nodes[:-1], stages, nodes[1:], strict=True):
        rows = np.concatenate([before[POSE:], inside, after[:4]])
        columns = layout.n_before_states + np.concatenate([before, inside, after])
        blocks.append(numbered[rows][:, columns].toarray() - 1)
    last = nodes[-1]
    columns = layout.n_before_states + np.concatenate([last[:4], last[POSE:]])
    return np.array(blocks), numbered[last[POSE:]][:, columns].toarray() - 1


def stability(point: Equilibrium) -> float:
    """Return the least eigenvalue of the scaled Hessian of the energy; an arm is stable above 0.

    In contact, only motions with constant contacts count. If the Hessian is unsymmetric, return the
    least real part. Then only the sign may be certain: without NeoHookean the eigenvalues amplify
    rounding by 1e13. Return 0 if the equations are singular.
    """
    if not is_loaded(point.system.arm, point.system.scene):
        # Each cross-section has its own Hessian, because no wrench couples the cross-sections.
        sections = point.system.sections
        v = point.states[point.system.layout.stages]
        jacobian = sections.balance(v, point.tensions[sections.tendon]).jacobian
        root = np.sqrt(_at_rest(sections.law, sections.body).T)
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
        near = _shifted(point, value.real - np.spacing(1e4))
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
        shifted = _shifted(point, shift)
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


def _shifted(point: Equilibrium, shift: float) -> Equilibrium:
    """Return the equations minus a multiple of the stiffness at rest."""
    layout = point.system.layout
    band = layout.band
    diagonal = np.flatnonzero(band.rows == band.columns - layout.n_before_states)
    at_rest = np.zeros(layout.n_states)
    at_rest[np.ravel(layout.stages)] = rest_stiffness(point.system)[1]
    nonzeros = point.nonzeros.copy()
    nonzeros[diagonal] -= shift * at_rest[band.rows[diagonal]]
    return Equilibrium(point.system, point.x, jacobian=nonzeros)


@lru_cache(maxsize=32)
def rest_stiffness(system: DiscreteRod) -> tuple[Array, Array]:
    """Return the weight of the stage of each strain [m], and the stiffness of the body at rest.

    Both have the shape (n,), by stage from base to tip, then by strain.
    """
    structure = system.layout.structure
    weight = np.outer(np.diff(system.mesh.s), gauss(structure.stages).b).ravel()
    stiff = _at_rest(structure.law, system.sections.body)
    return np.repeat(weight, stiff.shape[0]), stiff.ravel("F")


def _at_rest(law: CrossSection, body: Array) -> Array:
    """Return the stiffness (strains, N) of the body against each strain at rest."""
    EA, EJn, EJb, GI, GA = body[:STIFFNESS_SIZE]
    return np.array([GI, EJn, EJb, EA, GA, GA])[components(law)]
