"""The static grasp problem: can contact forces within friction cones balance a wrench?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import csc_array

from model.arm import Arm
from model.contact.contacts import Touch
from model.obstacles.base import Convex
from model.paths import Array
from model.shape import Shape
from planner.targets.hold import LEVER, Hold

# What tangential forces cost, so that those that nothing determines are small; how far cones are
# kept from their edges.
COST, _SHARP = 1e-9, 1e-11
# A kind of cone, and rows and numbers of unknowns x, of which rows @ x + numbers is in it.
Cone = tuple[Any, Array, Array]


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
    normal : (k,)
        These forces, >= 0.
    friction : float
        Tangential ones are up to so many times the normal ones.
    """

    bases: Array
    columns: Array
    still: Array
    normal: Array
    friction: float

    @classmethod
    def of(cls, arm: Arm, contacts: Iterable[Touch], hold: Hold) -> Grasp:
        """Return that of what a settled arm leans on."""
        touches = [touch for touch in contacts if touch.obstacle == hold.obstacle]
        points = np.array([touch.point for touch in touches]).reshape(-1, 3)
        forces = np.array([touch.force for touch in touches]).reshape(-1, 3)
        normals = np.array([touch.normal for touch in touches]).reshape(-1, 3)
        return cls.at(arm, hold, points, normals, (forces * normals).sum(axis=1))

    @classmethod
    def at(cls, arm: Arm, hold: Hold, points: Array, normals: Array, forces: Array) -> Grasp:
        """Return that of points (k, 3) [m], normals out of the object, and forces (k,) [N] there.

        Moments are over a tenth of the arm's length.
        """
        lever, size = LEVER * arm.length, hold.size(arm)
        first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
        first /= np.linalg.norm(first, axis=1)[:, None]
        bases = np.stack([first, np.cross(normals, first)], axis=2)
        levers, units = (points - hold.obstacle.numbers[:3]) / lever, bases.transpose(0, 2, 1)
        columns = np.concatenate([units, np.cross(levers[:, None], units)], axis=2)
        pressed = -forces[:, None] * normals
        total = np.append(pressed.sum(axis=0), np.cross(levers, pressed).sum(axis=0))
        wrench, m = np.array(hold.wrench), len(hold.wrench)
        wrench[3:] /= lever
        columns = columns.reshape(-1, 6).T[:m]
        return cls(bases, columns, (wrench + total[:m]) / size, forces / size, hold.friction)

    @cached_property
    def best(self) -> Array:
        """The tangential forces along the bases (2 k,) in their cones that leave least."""
        x = self._conic(np.eye(self.columns.shape[1] + 2)[-1], np.inf)
        z = np.zeros((self.normal.size, 2)) if x is None else x[:-2].reshape(-1, 2)
        most = self.friction * np.maximum(self.normal, 0.0)
        sizes = np.maximum(np.linalg.norm(z, axis=1), 1e-300)
        return np.asarray((z * np.minimum(1.0, most / sizes)[:, None]).ravel())

    @property
    def least(self) -> Array:
        """What they leave of the wrench (3,) or (6,)."""
        return np.asarray(self.still + self.columns @ self.best)

    def needed_friction(self, left: float) -> float:
        """Return the least coefficient of friction that leaves so much of the wrench at most.

        That of the grasp where no lesser one does.
        """
        x = self._conic(np.eye(self.columns.shape[1] + 2)[-2], left)
        return self.friction if x is None else float(max(x[-2], 0.0))

    def _conic(self, cost: Array, left: float) -> Array | None:
        """Return (z, mu, t) of least cost . (z, mu, t), mu and t up to friction and what is left.

        Tangential forces z are within cones of mu, and leave t. None where there are none.
        """
        f, [mu], [t] = np.split(np.eye(cost.size), [cost.size - 2, cost.size - 1])
        most = min(left, 2 * float(np.linalg.norm(self.still)))
        bounds = np.vstack([mu, -mu, -t]), np.array([0.0, self.friction, most])
        balance = np.vstack([t, self.columns @ f]), np.append(0.0, self.still)
        cones: list[Cone] = [(clarabel.NonnegativeConeT, *bounds)]
        cones.append((clarabel.SecondOrderConeT, *balance))
        for k, N in enumerate(self.normal):
            rows = np.vstack([max(N, 0.0) * mu, f[2 * k : 2 * k + 2]])
            cones.append((clarabel.SecondOrderConeT, rows, np.zeros(3)))
        solution = conic_program(COST * f.T @ f, cost, cones)
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


def grips_of(shape: Shape, hold: Hold) -> tuple[Grip, ...]:
    """Return the forces on an object that leave least of the wrench, from base to tip."""
    grasp, size = Grasp.of(shape.arm, shape.contacts, hold), hold.size(shape.arm)
    tangential = size * np.einsum("kij,kj->ki", grasp.bases, grasp.best.reshape(-1, 2))
    touches = [touch for touch in shape.contacts if touch.obstacle == hold.obstacle]
    pairs = zip(touches, tangential, strict=True)
    return tuple(Grip(hold.obstacle, touch.point, -touch.force, f) for touch, f in pairs)
