"""The static grasp problem: can contact forces within friction cones balance a wrench?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import clarabel
import numpy as np
from scipy.linalg import block_diag

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.touches import ContactPoint
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.extensions.conic import Cone, conic_program

# Lever arm by which moments are divided to compare them with forces, over the arm's length.
LEVER = 0.1
# Weight of the squares of tangential forces, which keeps undetermined forces small.
COST = 1e-9


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
    """A force of the arm on a held object.

    Attributes
    ----------
    obstacle : Convex
    point : (3,)
        Point of the surface, base frame [m].
    normal, tangential : (3,)
        Forces on the object [N]: the normal force of the equilibrium, and friction in its cone.
    """

    obstacle: Convex
    point: Array
    normal: Array
    tangential: Array


@dataclass(frozen=True, eq=False)
class Grasp:
    """The contact points of an object and the wrench on the object, over the size of the wrench.

    Attributes
    ----------
    bases : (k, 3, 2)
        Two directions perpendicular to each normal.
    columns : (3 or 6, 2 k)
        The wrenches of unit forces along the bases.
    still : (3,) or (6,)
        The wrench with the normal forces of the equilibrium.
    most : (k,)
        Largest tangential forces.
    """

    bases: Array
    columns: Array
    still: Array
    most: Array

    @classmethod
    def of(cls, arm: Arm, contacts: Iterable[ContactPoint], hold: HeldObject) -> Grasp:
        """Return the grasp of a settled arm."""
        touches = [touch for touch in contacts if touch.obstacle == hold.obstacle]
        points, normals, forces = (
            np.array([getattr(touch, name) for touch in touches]).reshape(-1, 3)
            for name in ("point", "normal", "force")
        )
        return cls.at(arm, hold, points, normals, (forces * normals).sum(axis=1))

    @classmethod
    def at(cls, arm: Arm, hold: HeldObject, points: Array, normals: Array, forces: Array) -> Grasp:
        """Return the grasp of points (k, 3) [m], outward normals, and normal forces (k,) [N].

        Moments are divided by LEVER times the arm's length.
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
        """Return several grasps as one."""
        still = np.concatenate([np.zeros(0), *(grasp.still for grasp in grasps)])
        most = np.concatenate([np.zeros(0), *(grasp.most for grasp in grasps)])
        bases = np.concatenate([np.zeros((0, 3, 2)), *(grasp.bases for grasp in grasps)])
        columns = block_diag(*(grasp.columns for grasp in grasps))
        return cls(bases, columns[: still.size, : 2 * most.size], still, most)

    @cached_property
    def best(self) -> Array:
        """The tangential forces along the bases (2 k,) that balance the wrench best."""
        x = self._conic(-1, np.inf)
        return np.zeros(2 * self.most.size) if x is None else x[:-2]

    @property
    def least(self) -> Array:
        """The remaining wrench (3,) or (6,) with the best tangential forces."""
        return np.asarray(self.still + self.columns @ self.best)

    def needed_friction(self, left: float) -> float:
        """Return the smallest share of the friction for which at most `left` of the wrench remains.

        1 if no smaller share suffices.
        """
        x = self._conic(-2, left)
        return 1.0 if x is None else float(max(x[-2], 0.0))

    def _conic(self, least: int, left: float) -> Array | None:
        """Return (z, mu, t) with the smallest component `least`, for mu <= 1 and t <= left.

        Tangential forces z are in the cones of the share mu of the friction; the remaining wrench
        has the norm t. None without solution.
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


def grips_of(shape: Shape, hold: HeldObject) -> tuple[Grip, ...]:
    """Return the forces on an object that balance the wrench best, from base to tip."""
    grasp, size = Grasp.of(shape.arm, shape.contacts, hold), hold.size(shape.arm)
    tangential = size * np.einsum("kij,kj->ki", grasp.bases, grasp.best.reshape(-1, 2))
    touches = [touch for touch in shape.contacts if touch.obstacle == hold.obstacle]
    pairs = zip(touches, tangential, strict=True)
    return tuple(Grip(hold.obstacle, touch.point, -touch.force, f) for touch, f in pairs)
