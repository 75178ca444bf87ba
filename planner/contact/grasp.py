"""The static grasp problem: can contact forces within friction cones balance a wrench?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

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
_COST = 1e-9
_SHARP = 1e-11


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
    """Places that touch an object, and the wrench on it.

    Attributes
    ----------
    points : (k, 3)
        Of the object's surface, from its centre [m].
    normals : (k, 3)
        Out of the object.
    normal : (k,)
        Forces along the normals, >= 0 [N]; on the object they push inwards.
    wrench : (3,) or (6,)
        On the object [N, N m].
    friction : float
    lever : float
        What moments are divided by [m].
    """

    points: Array
    normals: Array
    normal: Array
    wrench: Array
    friction: float
    lever: float

    @classmethod
    def of(cls, arm: Arm, contacts: Iterable[Touch], hold: Hold) -> Grasp:
        """Return that of what a settled arm leans on."""
        touches = [touch for touch in contacts if touch.obstacle == hold.obstacle]
        points = np.array([touch.point for touch in touches]).reshape(-1, 3)
        forces = np.array([touch.force for touch in touches]).reshape(-1, 3)
        normals = np.array([touch.normal for touch in touches]).reshape(-1, 3)
        out = (forces * normals).sum(axis=1)
        centre = hold.obstacle.numbers[:3]
        lever = LEVER * arm.length
        wrench = np.array(hold.wrench)
        return cls(points - centre, normals, out, wrench, hold.friction, lever)

    @cached_property
    def bases(self) -> Array:
        """Two directions across each normal (k, 3, 2), by the axis that is farthest from it."""
        axes = np.eye(3)[np.argmin(np.abs(self.normals), axis=1)]
        first = np.cross(self.normals, axes)
        first /= np.linalg.norm(first, axis=1)[:, None]
        return np.stack([first, np.cross(self.normals, first)], axis=2)

    def left(self, tangential: Array) -> Array:
        """Return the wrench that is left with tangential forces (k, 3): 0 if they balance."""
        forces = tangential - self.normal[:, None] * self.normals
        total = self.wrench.copy()
        total[:3] += forces.sum(axis=0)
        total[3:] += np.cross(self.points, forces).sum(axis=0)[: total.size - 3]
        return np.asarray(total)

    @cached_property
    def least(self) -> Array:
        """What the best tangential forces leave of the wrench (3,) or (6,) [N, N m]."""
        return self.left(self.best())

    def scaled(self, wrench: Array) -> Array:
        """Return a wrench with moments over the lever [N]."""
        scaled = wrench.copy()
        scaled[3:] /= self.lever
        return np.asarray(scaled)

    @property
    def _columns(self) -> Array:
        """What unit tangential forces along the bases add to the wrench (3 or 6, 2 k) [N]."""
        units = self.bases.transpose(0, 2, 1).reshape(-1, 3)
        moments = np.cross(np.repeat(self.points, 2, axis=0), units) / self.lever
        return np.hstack([units, moments]).T[: self.wrench.size]

    @property
    def _unit(self) -> float:
        return float(max(np.abs(self.wrench[:3]).max(), self.normal.max(initial=0.0)))

    def best(self) -> Array:
        """Return the tangential forces (k, 3) [N] in their cones that leave least of the wrench."""
        k, unit = len(self.normal), self._unit
        most = self.friction * np.maximum(self.normal, 0.0) / unit
        if not most.any():
            return np.zeros((k, 3))
        x = self._cone_program(np.eye(2 * k + 2)[-1], self.friction, np.inf)
        z = np.zeros((k, 2)) if x is None else x[:-2].reshape(k, 2)
        sizes = np.linalg.norm(z, axis=1)
        z *= np.minimum(1.0, most / np.maximum(sizes, 1e-300))[:, None]
        return np.asarray(unit * np.einsum("kij,kj->ki", self.bases, z))

    def needed_friction(self, accuracy: float) -> float:
        """Return the least coefficient of friction that leaves so much of the wrench [N] at most.

        That of the grasp where no lesser one does.
        """
        x = self._cone_program(np.eye(2 * len(self.normal) + 2)[-2], self.friction, accuracy)
        return self.friction if x is None else float(max(x[-2], 0.0))

    def _cone_program(self, cost: Array, friction: float, left: float) -> Array | None:
        """Return (z, mu, t) of least cost . (z, mu, t), mu and t up to `friction` and `left` [N].

        Scaled tangential forces z are within cones of mu, and leave t of the wrench. None where
        there are none. By clarabel (Goulart and Chen, arXiv:2405.12762, 2024).
        """
        k, unit, A = len(self.normal), self._unit, self._columns
        still, n = self.scaled(self.left(np.zeros((k, 3)))) / unit, 2 * k + 2
        cones, balance, eye = np.zeros((k, 3, n)), np.zeros((1 + still.size, n)), np.eye(n)
        cones[:, 0, -2] = -np.maximum(self.normal, 0.0) / unit
        cones[:, 1:, :-2] = -np.eye(2 * k).reshape(k, 2, 2 * k)
        balance[0, -1], balance[1:, :-2] = -1.0, -A
        most = min(left / unit, 2 * float(np.linalg.norm(still)))
        rows = np.vstack([cones.reshape(-1, n), balance, eye[-2:], -eye[-2:-1]])
        offsets = np.concatenate([np.zeros(3 * k + 1), still, [friction, most, 0.0]])
        kinds = [clarabel.SecondOrderConeT(3)] * k
        kinds += [clarabel.SecondOrderConeT(len(balance)), clarabel.NonnegativeConeT(3)]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _SHARP
        H = csc_array(np.diag(np.append(np.full(2 * k, _COST), [0.0, 0.0])))
        solution = clarabel.DefaultSolver(
            H, cost, csc_array(rows), offsets, kinds, settings
        ).solve()
        solved = str(solution.status) in ("Solved", "AlmostSolved", "InsufficientProgress")
        return np.array(solution.x) if solved else None


def grips_of(shape: Shape, hold: Hold) -> tuple[Grip, ...]:
    """Return the forces on an object that leave least of the wrench, from base to tip."""
    grasp, centre = Grasp.of(shape.arm, shape.contacts, hold), hold.obstacle.numbers[:3]
    pressed = -grasp.normal[:, None] * grasp.normals
    parts = zip(grasp.points + centre, pressed, grasp.best(), strict=True)
    return tuple(Grip(hold.obstacle, *forces) for forces in parts)
