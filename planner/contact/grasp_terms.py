"""What a Hold asks of an equilibrium with contact, and how that moves with the tensions.

The rows are the wrench that is left, and what is spared of friction cones, over the wrench's size.
Tangential forces are unknowns beside the tensions, at the points that touch and at the ends of
parts that lie; within these parts none are asked for. Cones are pyramids of 12 sides inside of
them, so that these rows are linear in the tangential forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.contact.touches import Touches
from model.cross_section.reported import kinematics
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.loads import contacts
from model.obstacles.base import SIZE, with_gradient
from model.paths import Array
from model.rotations import matrices
from model.transcription.layout import POSE
from model.transcription.system import System
from planner.contact.grasp import Grasp, axes_across
from planner.targets.hold import LEVER, Hold

# Sides of the pyramids inside of friction cones.
_ANGLES = 2 * np.pi * np.arange(12) / 12
# Normals that lean so much along the axis which directions are across take another one.
_ALONG = 0.95
_SIDES = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclass(frozen=True, eq=False)
class GraspTerms:
    """The rows of a Hold; n_z are two tangential forces a place.

    Attributes
    ----------
    tangential : (n_z,)
        Over the size of the wrench.
    axes : (n_z / 2, 3)
        That directions of tangential forces are across: kept from terms to terms, as with others
        the same numbers would be other forces.
    equality, inequality : (m,), (k,)
    equality_jacobian, inequality_jacobian : (m, n_tendons + n_z), (k, n_tendons + n_z)
        By tensions [1/N] and tangential forces.
    """

    tangential: Array
    axes: Array
    equality: Array
    inequality: Array
    equality_jacobian: Array
    inequality_jacobian: Array


def grasp_terms(
    here: Linearised, hold: Hold, before: GraspTerms | None, tangential: Array | None
) -> GraspTerms:
    """Return the rows at an equilibrium.

    With tangential forces (n_z,) along the directions of terms before; the best ones where there
    are none, or where another number of places touches.
    """
    system, size = here.system, hold.size(here.system.arm)
    points, by_points, N, by_N, rough = _places(here, hold)
    k, m, n = N.size, int(rough.sum()), here.tensions.size
    normals = hold.obstacle.gradient(points)[rough] if m else np.zeros((0, 3))
    axes = axes_across(normals)
    if before is None or tangential is None or tangential.size != 2 * m:
        best = _grasp(here, hold, points, N).best(_SIDES)[rough]
        forces = np.einsum("kij,ki->kj", _bases(normals, axes), best).ravel() / size
    elif (np.abs((normals * before.axes).sum(axis=1)) > _ALONG).any():
        own = np.einsum("kij,kj->ki", _bases(normals, before.axes), tangential.reshape(m, 2))
        forces = np.einsum("kij,ki->kj", _bases(normals, axes), own).ravel()
    else:
        forces, axes = tangential, before.axes
    full, lever = len(hold.wrench) == 6, LEVER * system.arm.length
    wrench = np.zeros(6)
    wrench[: len(hold.wrench)] = hold.wrench
    given = (hold.obstacle.numbers, np.concatenate([wrench, [hold.friction, size, lever]]))
    found = _rows(k, tuple(rough.tolist()), full)(points.T, N, forces, axes.T, *given)
    equality, inequality, *jacobian = (np.array(part) for part in found)
    both = []
    for by_u, by_n, by_z in (jacobian[:3], jacobian[3:]):
        moved = by_u @ by_points.reshape(3 * k, n) + by_n @ by_N
        both.append(np.hstack([moved, by_z]))
    return GraspTerms(forces, axes, equality.ravel(), inequality.ravel(), *both)


def _bases(normals: Array, axes: Array) -> Array:
    """Return the directions (k, 3, 2) of tangential forces, as the rows have them."""
    first = np.cross(normals, axes)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=2)


def _grasp(here: Linearised, hold: Hold, points: Array, N: Array) -> Grasp:
    """Return the static grasp problem of midline points (k, 3) and normal forces (k,)."""
    numbers = hold.obstacle.numbers
    off, normals = hold.obstacle.distance(points), hold.obstacle.gradient(points)
    surface = points - off[:, None] * normals - numbers[:3]
    lever = LEVER * here.system.arm.length
    return Grasp(surface, normals, N, np.array(hold.wrench), hold.friction, lever)


def _places(here: Linearised, hold: Hold) -> tuple[Array, Array, Array, Array, Array]:
    """Return midline points (k, 3), their derivatives by tensions, normal forces (k,), theirs.

    And where tangential forces are.
    """
    system, touches = here.system, Touches.of(here.system)
    j = [own.obstacle for own in contacts(system.scene)].index(hold.obstacle)
    own = np.flatnonzero(touches.held[:, j] | touches.inside[:, j])
    nodes, moved = system.of.nodes[own, 4:POSE], here.by_tensions
    points, by_points = here.states[nodes], moved[nodes]
    shifts = np.flatnonzero(touches.point[own, j] & (system.mesh.s[own] < system.arm.length))
    if shifts.size:
        s = system.mesh.s[own[shifts]]
        pose, v = poses_and_strains(system, here.x, s)
        along = np.einsum("kij,kj->ki", matrices(pose[:, :4]), kinematics(system.of.form.law, v)[1])
        shift = system.of.touches[own[shifts], j, 1]
        by_points[shifts] += along[:, :, None] * moved[shift][:, None, :]
    N = nodal_forces(system, touches, here.states)[own, j]
    by_N = nodal_forces(system, touches, moved)[own, j]
    return points, by_points, N, by_N, touches.held[own, j]


def nodal_forces(system: System, touches: Touches, columns: Array) -> Array:
    """Return contact forces of the nodes (N + 1, K, ...) of states, or their derivatives.

    Of a pressure that is linear between nodes by the lever rule, as model.contact.contacts has it.
    """
    more = (None,) * (columns.ndim - 1)
    own = system.of.touches
    found = columns[own[:, :, 0]] * touches.held[(..., *more)]
    p = columns[own[:, :, 1]] * (touches.end | touches.inside)[(..., *more)]
    h = (np.diff(system.mesh.s)[:, None] * touches.lies)[(..., *more)]
    found[:-1] += h * (2 * p[:-1] + p[1:]) / 6
    found[1:] += h * (p[:-1] + 2 * p[1:]) / 6
    return np.asarray(found)


@lru_cache(maxsize=64)
def _rows(k: int, rough: tuple[bool, ...], full: bool) -> ca.Function:
    """Return (points (3, k), N, tangential, axes (3, m), body, numbers) -> rows, derivatives.

    Derivatives of the wrench that is left by points, N and tangential forces, then of the cones.
    """
    m = sum(rough)
    U, N, z = ca.MX.sym("U", 3, k), ca.MX.sym("N", k), ca.MX.sym("z", 2 * m)
    B, body, c = ca.MX.sym("B", 3, m), ca.MX.sym("body", SIZE), ca.MX.sym("c", 9)
    force, moment = c[:3], c[3:6]
    friction, size, lever = c[6], c[7], c[8]
    sides = ca.DM(_SIDES)
    cones, at = list[ca.MX](), 0
    for i in range(k):
        d, n = with_gradient()(U[:, i], body)
        total = -N[i] * n
        if rough[i]:
            across, own_z = ca.cross(n, B[:, at]), z[2 * at : 2 * at + 2]
            across /= ca.norm_2(across)
            total += size * (own_z[0] * across + own_z[1] * ca.cross(n, across))
            most = friction * np.cos(np.pi / len(_SIDES)) * N[i] / size
            cones.append(most - sides @ own_z)
            at += 1
        force += total
        moment += ca.cross(U[:, i] - d * n - body[:3], total)
    left = ca.vertcat(force, moment / lever) if full else force
    rows = [left / size, ca.vertcat(ca.MX(0, 1), *cones)]
    jacobian = [ca.densify(ca.jacobian(row, by)) for row in rows for by in (U, N, z)]
    return ca.Function("grasp", [U, N, z, B, body, c], [*rows, *jacobian])
