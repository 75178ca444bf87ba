"""The static grasp problem: can contact forces within friction cones balance a wrench?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import clarabel
import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_array

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.touches import ContactPoint
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array
from octoplan.model.shape import Shape

# Lever arm by which moments are divided to compare them with forces, over the arm's length.
LEVER = 0.1
# What tangential forces cost, so that those that nothing determines are small; how far cones are
# kept from their edges.
COST, _SHARP = 1e-9, 1e-11
# A kind of cone, and rows and numbers of unknowns x, of which rows @ x + numbers is in it.
Cone = tuple[Any, Array, Array]


class HeldObject(Protocol):
    """An object that the arm holds; see Hold."""

    @property
    def obstacle(self) -> Convex:
        """The object."""

    @property
    def wrench(self) -> tuple[float, ...]:
        """The wrench on the object: a force [N], or force and moment [N, N m]."""

    @property
    def friction(self) -> float:
        """The coefficient of friction between arm and object."""

    def size(self, arm: Arm) -> float:
        """Return the norm of the wrench [N]."""


@dataclass(frozen=True, eq=False)
class Grip:
    """A force by which an arm holds an object.

    Attributes
    ----------
    obstacle : Convex
    point : (3,)
        Of its surface, base frame [m].
    normal, tangential : (3,)
        On the object [N]: what the arm's equilibrium presses, and friction within its cone.
    """

    obstacle: Convex
    point: Array
    normal: Array
    tangential: Array


@dataclass(frozen=True, eq=False)
class Grasp:
    """Places that touch an object, and the wrench on it: forces over its size.

    Attributes
    ----------
    bases : (k, 3, 2)
        Two directions across each normal.
    columns : (3 or 6, 2 k)
        The wrenches of unit forces along them.
    still : (3,) or (6,)
        The wrench with the forces along the normals, which the arm's equilibrium presses.
    most : (k,)
        How large tangential forces are by friction at the most.
    """

    bases: Array
    columns: Array
    still: Array
    most: Array

    @classmethod
    def of(cls, arm: Arm, contacts: Iterable[ContactPoint], hold: HeldObject) -> Grasp:
        """Return that of what a settled arm leans on."""
        touches = [touch for touch in contacts if touch.obstacle == hold.obstacle]
        points, normals, forces = (
            np.array([getattr(touch, name) for touch in touches]).reshape(-1, 3)
            for name in ("point", "normal", "force")
        )
        return cls.at(arm, hold, points, normals, (forces * normals).sum(axis=1))

    @classmethod
    def at(cls, arm: Arm, hold: HeldObject, points: Array, normals: Array, forces: Array) -> Grasp:
        """Return that of points (k, 3) [m], normals out of the object, and forces (k,) [N] there.

        Moments are over a tenth of the arm's length.
        """
        lever, size = LEVER * arm.length, hold.size(arm)
        first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
        first /= np.linalg.norm(first, axis=1)[:, None]
        bases = np.stack([first, np.cross(normals, first)], axis=2)
        levers, units = (points - hold.obstacle.parameters[:3]) / lever, bases.transpose(0, 2, 1)
        columns = np.concatenate([units, np.cross(levers[:, None], units)], axis=2)
        pressed = -forces[:, None] * normals
        total = np.append(pressed.sum(axis=0), np.cross(levers, pressed).sum(axis=0))
        wrench, m = np.array(hold.wrench), len(hold.wrench)
        wrench[3:] /= lever
        columns = columns.reshape(-1, 6).T[:m]
        return cls(bases, columns, (wrench + total[:m]) / size, hold.friction * forces / size)

    @classmethod
    def joined(cls, grasps: Sequence[Grasp]) -> Grasp:
        """Return several as one."""
        still = np.concatenate([np.zeros(0), *(grasp.still for grasp in grasps)])
        most = np.concatenate([np.zeros(0), *(grasp.most for grasp in grasps)])
        bases = np.concatenate([np.zeros((0, 3, 2)), *(grasp.bases for grasp in grasps)])
        columns = block_diag(*(grasp.columns for grasp in grasps))
        return cls(bases, columns[: still.size, : 2 * most.size], still, most)

    @cached_property
    def best(self) -> Array:
        """The tangential forces along the bases (2 k,) in their cones that leave least."""
        x = self._conic(-1, np.inf)
        return np.zeros(2 * self.most.size) if x is None else x[:-2]

    @property
    def least(self) -> Array:
        """What they leave of the wrench (3,) or (6,)."""
        return np.asarray(self.still + self.columns @ self.best)

    def needed_friction(self, left: float) -> float:
        """Return the least part of the friction that leaves so much of the wrench at most.

        All of it where no less does.
        """
        x = self._conic(-2, left)
        return 1.0 if x is None else float(max(x[-2], 0.0))

    def _conic(self, least: int, left: float) -> Array | None:
        """Return (z, mu, t), of which one is `least`: mu up to 1, t up to what is left.

        Tangential forces z are within cones of that part of the friction, and leave t. None where
        there are none.
        """
        *f, mu, t = each = np.eye(self.columns.shape[1] + 2)
        most = min(left, 2 * float(np.linalg.norm(self.still)))
        forces = np.reshape(f, (-1, each.shape[1]))
        balance = np.vstack([t, self.columns @ forces]), np.append(0.0, self.still)
        cones: list[Cone] = [
            (clarabel.NonnegativeConeT, np.vstack([mu, -mu, -t]), np.array([0.0, 1.0, most])),
            (clarabel.SecondOrderConeT, *balance),
        ]
        for k, bound in enumerate(self.most):
            rows = np.vstack([max(bound, 0.0) * mu, forces[2 * k : 2 * k + 2]])
            cones.append((clarabel.SecondOrderConeT, rows, np.zeros(3)))
        solution = conic_program(COST * forces.T @ forces, each[least], cones)
        return None if solution is None else solution[0]


def conic_program(H: Array, cost: Array, cones: Sequence[Cone]) -> tuple[Array, Array] | None:
    """Return x of least x . H x / 2 + cost . x within cones, and their multipliers; None without.

    By clarabel (Goulart and Chen, arXiv:2405.12762, 2024).
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _SHARP
    kinds, rows, numbers = zip(*cones, strict=True)
    sized = [kind(len(offsets)) for kind, offsets in zip(kinds, numbers, strict=True)]
    A, b = csc_array(-np.vstack(rows)), np.concatenate(numbers)
    solution = clarabel.DefaultSolver(csc_array(np.triu(H)), cost, A, b, sized, settings).solve()
    solved = str(solution.status) in ("Solved", "AlmostSolved", "InsufficientProgress")
    return (np.array(solution.x), np.array(solution.z)) if solved else None


def grips_of(shape: Shape, hold: HeldObject) -> tuple[Grip, ...]:
    """Return the forces on an object that leave least of the wrench, from base to tip."""
    grasp, size = Grasp.of(shape.arm, shape.contacts, hold), hold.size(shape.arm)
    tangential = size * np.einsum("kij,kj->ki", grasp.bases, grasp.best.reshape(-1, 2))
    touches = [touch for touch in shape.contacts if touch.obstacle == hold.obstacle]
    pairs = zip(touches, tangential, strict=True)
    return tuple(Grip(hold.obstacle, touch.point, -touch.force, f) for touch, f in pairs)
