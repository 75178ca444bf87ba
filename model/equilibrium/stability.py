"""Whether an equilibrium is stable: the Hessian of its potential energy, tensions held.

With the nodes eliminated the equations' Jacobian is, times the stages' weights, the Hessian of the
potential energy in the strains. Scaled by the stiffness of the body at rest its eigenvalues are
numbers: 1 for an arm at rest, 1 - P / P_cr for a column under an axial load P, 0 where the arm
buckles. Loads that have no potential (followers, currents), and the paper's tangent, make it
unsymmetric: then the real parts count, and nothing is said of flutter. Tensions that friction has
spread along the tendons are held as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from octoplan.model.cross_section.law import CrossSection, components
from octoplan.model.equilibrium.linearised import Equilibrium, Index
from octoplan.model.loads import is_conservative, is_loaded
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.nodes import POSE
from octoplan.model.support.errors import SingularError

# Of Arnoldi's method, vectors for each mode and restarts; the tolerance of an eigenvalue alone,
# whose error is the square of that where the Hessian is symmetric, and of one whose sign matters.
_VECTORS, _RESTARTS, _CLOSE, _ROUGH = 40, 10, 1e-8, 1e-2
# Reciprocals nearer to 0 are rounding, and the 0 of contacts; over the largest of the whole matrix.
_NONE, _ZERO = 1e-4, 1e-12
# How many more eigenvalues are looked at where they may be complex: the least real part need not be
# that of the one nearest to a number below.
_MORE = 8
# Imaginary parts up to this, over the eigenvalue, are rounding.
_REAL = 1e-9
# No eigenvalue is looked for below this one.
_LOWEST = -1e6


def is_stable(point: Equilibrium, margin: float = 0.0) -> bool:
    """Return whether the stability of an equilibrium is above a margin, with contacts closed."""
    return bool(are_stable([_less_stiff(point, margin) if margin else point])[0])


def are_stable(candidates: Sequence[Equilibrium | None]) -> NDArray[np.bool_]:
    """Return whether equilibria of one system are stable, with contacts closed; None is not.

    Without contacts: whether all pivots of the Hessian of the arm's energy are positive.
    Elements are eliminated from tip to base. With w_k = P_k theta_k what the part beyond a node
    needs to be turned there by theta_k, P = 0 at the tip under dead loads, the strains of the next
    element meet the stiffness S of body, tendons and of what lies beyond: all S definite, and only
    then, all of the energy's Hessian is. Source: inertia is additive (Haynsworth, Linear Algebra
    and its Applications 1, 1968).
    """
    stable = np.array([each is not None for each in candidates], dtype=bool)
    points = [each for each in candidates if each is not None]
    if not points:
        return stable
    if any(group.n_variables for group in points[0].system.layout.node_groups):
        stable[stable] = [p.factor is not None and unstable_mode(p) is None for p in points]
        return stable
    of = points[0].system.layout
    nonzeros = np.array([np.append(each.nonzeros, 0.0) for each in points])  # the last for place -1
    blocks, at_tip = _block_places(of)
    J, tip = nonzeros.take(blocks, axis=1), nonzeros.take(at_tip, axis=1)
    w, n = of.structure.n_wrench, of.structure.stages * of.structure.n_strains
    small = rotation_basis(np.array([each.states for each in points])[:, of.nodes[:, :4]])
    v, nxt = slice(POSE + w, POSE + w + n), POSE + w + n
    after = slice(nxt + POSE, nxt + POSE + w)
    moment, quaternion = J[..., :w, :], J[..., w + n : w + n + 4, :]
    back, turned = 4 * small[:, 1:].swapaxes(2, 3), small[:, :-1]
    # By the turn at the first node and the strains: the turn at the last, then the balances of the
    # node and of the stages, these two without what lies beyond. Stages count by their weights.
    by_turn = -back @ (quaternion[..., :4] @ turned)
    on = np.concatenate([by_turn, -back @ quaternion[..., v]], axis=3)
    weight = np.repeat(gauss(of.structure.stages).b, of.structure.n_strains)
    counted = J[..., : w + n, :] * np.concatenate([np.ones(w), weight])[:, None]
    values = np.concatenate([counted[..., :4] @ turned, counted[..., v]], axis=3)
    beyond = counted[..., after]
    held = -np.linalg.inv(moment[..., POSE : POSE + w])
    P = -np.linalg.solve(tip[..., 4:], tip[..., :4]) @ small[:, -1]
    left = np.flatnonzero(stable)
    for k in range(of.elements)[::-1]:
        both = values[:, k] + beyond[:, k] @ (P @ on[:, k])
        definite = np.ones(len(both), dtype=bool)
        for i, S in enumerate(both[:, w:, 3:]):
            # All eigenvalues of a pivot have positive real parts, where they are numbers.
            if dpotrf(S + S.T)[1]:
                definite[i] = np.isfinite(S).all() and (np.linalg.eigvals(S).real > 0).all()
        if not definite.all():
            left, both, values, beyond, on, held = (
                each[definite] for each in (left, both, values, beyond, on, held)
            )
        S, across = both[:, w:, 3:], both[:, w:, :3]
        P = held[:, k] @ (both[:, :w, :3] - both[:, :w, 3:] @ np.linalg.solve(S, across))
    stable[:] = False
    stable[left[np.isfinite(P).all(axis=(1, 2))]] = True  # what is no number once stays so
    return stable


def rotation_basis(q: Array) -> Array:
    """Return the changes (..., 4, 3) of unit quaternions (..., 4) by small turns, base frame."""
    w, x, y, z = np.moveaxis(q / 2, -1, 0)
    rows = [[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@lru_cache(maxsize=16)
def _block_places(of: Layout) -> tuple[Index, Index]:
    """Return places among the nonzeros, -1 for none, of the elements' blocks and of the tip's.

    Those of the elements are (N, rows, columns). Rows are the wrench at the first node, the stages'
    balance, the quaternion at the last node; columns pose and wrench at the first node, strains,
    pose and wrench at the last. Rows of the tip are its wrench, columns its quaternion and wrench.
    """
    at, w, blocks = of.band, of.structure.n_wrench, []
    shape = (of.n_states, of.n_x)
    numbered = csr_array((np.arange(1, at.rows.size + 1), (at.rows, at.columns)), shape)
    nodes, stages = of.nodes[:, : POSE + w], of.stages.reshape(of.elements, -1)
    for before, inside, after in zip(nodes[:-1], stages, nodes[1:], strict=True):
        rows = np.concatenate([before[POSE:], inside, after[:4]])
        columns = of.n_before_states + np.concatenate([before, inside, after])
        blocks.append(numbered[rows][:, columns].toarray() - 1)
    last = nodes[-1]
    columns = of.n_before_states + np.concatenate([last[:4], last[POSE:]])
    return np.array(blocks), numbered[last[POSE:]][:, columns].toarray() - 1


def stability(point: Equilibrium) -> float:
    """Return the least eigenvalue of the scaled Hessian of the energy; below 0 it is unstable.

    With contacts closed, of the directions in which the arm can move with them. Of a Hessian that
    is not symmetric the least real part, of which no more than the sign may be certain: without
    NeoHookean its eigenvalues magnify rounding 1e13 times. 0 where the arm is about to buckle.
    """
    if not is_loaded(point.system.scene):
        # No wrench couples the cross-sections: each has a Hessian of its own.
        at = point.system.sections
        v, pulls = point.states[point.system.layout.stages], point.tensions[at.tendon]
        jacobian, root = at.balance(v, pulls).jacobian, np.sqrt(_at_rest(at.law, at.body).T)
        scaled = jacobian / root[:, :, None] / root[:, None, :]
        return float(np.linalg.eigvals(scaled).real.min())
    try:
        return float(_least(point, 1, tolerance=_CLOSE)[0][0].real)
    except (SingularError, np.linalg.LinAlgError):
        return 0.0


def least_modes(point: Equilibrium, count: int) -> tuple[Array, Array]:
    """Return the least eigenvalues (count,), and the changes of the states in their modes.

    Modes are (n_states, count): the changes y of the states with J y = lambda B y, where J is the
    equations' Jacobian and B the stiffness of the body at rest, at the stages. Of what is complex
    the real parts count. Raises SingularError.
    """
    values, bends, shifted = _least(point, count)
    return values.real, _spread(shifted, (bends * values).real)


def _spread(point: Equilibrium, bends: Array, transposed: bool = False) -> Array:
    """Return the changes of the states (n_states, count) in modes (n, count) at the stages."""
    right = np.zeros((point.system.layout.n_states, bends.shape[1]), bends.dtype)
    right[np.ravel(point.system.layout.stages)] = rest_stiffness(point.system)[1][:, None] * bends
    if np.isrealobj(right):
        return point.solve(right, transposed)
    parts = [point.solve(np.ascontiguousarray(x), transposed) for x in (right.real, right.imag)]
    return np.asarray(parts[0] + 1j * parts[1])


def unstable_mode(point: Equilibrium) -> Array | None:
    """Return the strains of the least stable mode (N stages, strains), that rotate by some 1 rad.

    None where an equilibrium is stable with its contacts closed, or about to buckle.
    """
    if point.factor is None:
        return None
    values, bends = _reciprocals(point, (1, 1), "SR", _ROUGH)
    least = int(np.argmin(values.real))
    if values[least].real > -_NONE:
        return None
    of, (weight, _) = point.system.layout, rest_stiffness(point.system)
    mode = bends[:, least].real.reshape(of.stages.shape)
    curvatures = np.abs(mode[:, : 2 + of.structure.law.torsion])
    rotations = weight.reshape(mode.shape)[:, :1] * curvatures
    return np.asarray(mode / rotations.sum(axis=0).max())


def stability_slope(point: Equilibrium) -> tuple[float, Array]:
    """Return the stability, and its derivatives by the tensions (n_tendons,) [1/N].

    With modes y and w of J and of its transpose, J y = lambda B y, the eigenvalue changes by
    w . dJ y / (w . B y), dJ that of the equations' Jacobian as tensions and states change. Where
    loads have no potential both may be complex. Raises SingularError.
    """
    of, (weight, stiff) = point.system.layout, rest_stiffness(point.system)
    (value,), bends, shifted = _least(point, 1)
    if abs(value.imag) <= _REAL * abs(value):
        # Inverse iteration, from the mode where there is an energy: of the same of two alike.
        near = _less_stiff(point, value.real - np.spacing(1e4))
        w = _spread(near, weight[:, None] * bends.real, transposed=True)
    else:
        (other,), left, _ = _least(point, 1, transposed=True)
        w = _spread(shifted, left.conj() if value.imag * other.imag < 0 else left, transposed=True)
    y, w = _spread(shifted, bends)[:, 0], w[:, 0]
    places, (rows, columns) = np.ravel(of.stages), of.equations.hessian.triplet
    H = of.equations.hessian(point.x, point.system.p, w.real)
    if np.iscomplexobj(w):
        H = H + 1j * of.equations.hessian(point.x, point.system.p, w.imag)
    mode = np.append(np.zeros(of.n_before_states), y)
    by_unknowns = np.vstack([np.eye(of.n_before_states, of.n_tendons), point.by_tensions])
    slope = (mode[rows] * H) @ by_unknowns[columns]
    return float(value.real), (slope / (w[places] @ (stiff * y[places]))).real


def _least(
    point: Equilibrium, count: int, transposed: bool = False, tolerance: float = 0.0
) -> tuple[Array, Array, Equilibrium]:
    """Return the least eigenvalues, their modes at the stages (n, count), and what spreads these.

    Those that are nearest to a number below them all; the last are the equations with so much less
    stiffness. Where loads have no potential eigenvalues may be complex, and more are looked at, as
    far as they are found: most are near 1, of any number.
    With `transposed` modes are those of the transpose.
    """
    more = 0 if is_conservative(point.system.scene) else _MORE
    if more and point.near:  # of an unsymmetric matrix eigenvalues may magnify any error
        point = Equilibrium(point.system, point.x)
    below, shifted = 0.0, point
    while not is_stable(shifted) and below > _LOWEST:
        below = min(4 * below, -1.0)
        shifted = _less_stiff(point, below)
    values, bends = _reciprocals(shifted, (count, count + more), "LM", tolerance, transposed)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(np.abs(values) > _ZERO * np.abs(values).max(), 1 / values, np.inf)
    least = np.argsort(values.real)[:count]
    return values[least] + below, bends[:, least], shifted


def _reciprocals(
    point: Equilibrium,
    sought: tuple[int, int],
    which: Literal["LM", "SR"],
    tolerance: float,
    transposed: bool = False,
) -> tuple[Array, Array]:
    """Return the largest or least reciprocals of eigenvalues, and their modes at the stages (n, .).

    From so many to so many as are `sought`, as far as they converge, by Arnoldi's method on the
    inverse of the equations; or of the whole matrix where many eigenvalues are one. With contacts
    as equations this is, in the strains, the Hessian's inverse where the arm can move with them,
    and 0 across.
    """
    of, (weight, stiff) = point.system.layout, rest_stiffness(point.system)
    places, before, after = np.ravel(of.stages), np.sqrt(stiff / weight), np.sqrt(weight * stiff)

    def inverse(bends: Array) -> Array:
        right = np.zeros((of.n_states, *bends.shape[1:]))
        right[places] = (before * bends.T).T
        return np.asarray((after * point.solve(right, transposed)[places].T).T)

    n = stiff.size
    operator, start = LinearOperator((n, n), matvec=inverse), np.random.default_rng(0)
    v0, (least, most) = start.standard_normal(n), sought
    # More of both before all of the matrix, which on fine meshes is too large; up to as many
    # vectors it takes less time.
    for more in (1, 4):
        width = more * _VECTORS * most
        if width >= n:
            break
        size = {"ncv": width, "maxiter": more * _RESTARTS, "v0": v0}
        try:
            values, vectors = eigs(operator, most, which=which, tol=tolerance, **size)
        except ArpackNoConvergence as part:
            values, vectors = part.eigenvalues, part.eigenvectors
        if values.size >= least:
            return values, (vectors.T / after).T
    values, vectors = np.linalg.eig(inverse(np.eye(n)))
    return values, (vectors.T / after).T


def _less_stiff(point: Equilibrium, by: float) -> Equilibrium:
    """Return the equations with so much less of the stiffness at rest."""
    at, of = point.system.layout.band, point.system.layout
    diagonal = np.flatnonzero(at.rows == at.columns - of.n_before_states)
    at_rest, nonzeros = np.zeros(of.n_states), point.nonzeros.copy()
    at_rest[np.ravel(of.stages)] = rest_stiffness(point.system)[1]
    nonzeros[diagonal] -= by * at_rest[at.rows[diagonal]]
    return Equilibrium(point.system, point.x, jacobian=nonzeros)


@lru_cache(maxsize=32)
def rest_stiffness(system: DiscreteRod) -> tuple[Array, Array]:
    """Return the weight of each strain's stage [m], and the stiffness of the body at rest there.

    Both by stage and strain (n,), base to tip.
    """
    m = system.layout.structure.stages
    weight = np.outer(np.diff(system.mesh.s), gauss(m).b).ravel()
    stiff = _at_rest(system.layout.structure.law, system.sections.body)
    return np.repeat(weight, stiff.shape[0]), stiff.ravel("F")


def _at_rest(law: CrossSection, numbers: Array) -> Array:
    """Return the stiffness (strains, N) of the body against each strain at rest."""
    EA, EJ, GI, GA = numbers[:4]
    return np.array([GI, EJ, EJ, EA, GA, GA])[components(law)]
