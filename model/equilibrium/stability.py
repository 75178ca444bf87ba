"""Whether an equilibrium is stable: the Hessian of its potential energy is positive definite.

Elimination of the node states from the Jacobian of the equilibrium leaves, times the weights of the
stages, the Hessian of the potential energy in the strains. Its eigenvalues are scaled by the
stiffness of the body at rest: 1 for an arm at rest, 1 - P / P_cr for a column under an axial load
P, 0 if the arm buckles. Loads without a potential (followers, currents) and the paper's tangent
make the matrix unsymmetric; then the real parts count, and flutter is not detected. Tensions are
constant, with friction along the tendons. octoplan.model.equilibrium.modes computes eigenvalues.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_array

from octoplan.model.cross_section.law import STIFFNESS_SIZE, CrossSection, components
from octoplan.model.equilibrium.linearised import Equilibrium, Index
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.layout import Layout
from octoplan.model.rotations import POSE


def is_stable(point: Equilibrium, margin: float = 0.0) -> bool:
    """Return whether the stability of an equilibrium exceeds a margin at constant contacts."""
    return bool(are_stable([with_shift(point, margin) if margin else point])[0])


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
    if points[0].system.layout.couples_nodes:
        from octoplan.model.equilibrium.modes import unstable_mode

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
        pivots = balance[:, w:, 3:]
        # A pivot may have eigenvalues with positive real parts only, but no such symmetric part.
        definite = np.array(
            [not dpotrf(S + S.T)[1] or _has_positive_parts(S) for S in pivots], dtype=bool
        )
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


def _has_positive_parts(S: Array) -> bool:
    """Return whether the real parts of all eigenvalues of a pivot are positive."""
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


def with_shift(point: Equilibrium, shift: float) -> Equilibrium:
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
    stiff = stiffness_at_rest(structure.law, system.sections.body)
    return np.repeat(weight, stiff.shape[0]), stiff.ravel("F")


def stiffness_at_rest(law: CrossSection, body: Array) -> Array:
    """Return the stiffness (strains, N) of the body against each strain at rest."""
    EA, EJn, EJb, GI, GA = body[:STIFFNESS_SIZE]
    return np.array([GI, EJn, EJb, EA, GA, GA])[components(law)]
