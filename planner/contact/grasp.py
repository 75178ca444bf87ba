"""The static grasp problem: can contact forces within friction cones balance a wrench?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from model.arm import Arm
from model.obstacles.base import Convex
from model.paths import Array
from model.shape import Shape
from planner.solve.quadratic import quadratic
from planner.targets.hold import LEVER, Hold

# The least that friction forces cost, so that those that nothing determines are small.
_COST, _LEAST_COST = 1e-9, 1e-10
# What pyramids may be missed by, over the largest force: more of it would pass those of small ones.
_MISSED = 1e-11


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
    def of(cls, shape: Shape, hold: Hold) -> Grasp:
        """Return that of a settled arm."""
        own = [touch for touch in shape.contacts if touch.obstacle == hold.obstacle]
        points = np.array([touch.point for touch in own]).reshape(-1, 3)
        forces = np.array([touch.force for touch in own]).reshape(-1, 3)
        normals = hold.obstacle.gradient(points) if own else points
        out = (forces * normals).sum(axis=1)
        centre = hold.obstacle.numbers[:3]
        lever = LEVER * shape.arm.length
        wrench = np.array(hold.wrench)
        return cls(points - centre, normals, out, wrench, hold.friction, lever)

    @cached_property
    def bases(self) -> Array:
        """Two directions across each normal (k, 3, 2)."""
        found = np.zeros((len(self.normal), 3, 2))
        for i, (n, axis) in enumerate(zip(self.normals, axes_across(self.normals), strict=True)):
            a = np.cross(n, axis)
            a /= np.linalg.norm(a)
            found[i] = np.column_stack([a, np.cross(n, a)])
        return found

    def left(self, tangential: Array) -> Array:
        """Return the wrench that is left with tangential forces (k, 3): 0 if they balance."""
        forces = tangential - self.normal[:, None] * self.normals
        total = self.wrench.copy()
        total[:3] += forces.sum(axis=0)
        total[3:] += np.cross(self.points, forces).sum(axis=0)[: total.size - 3]
        return np.asarray(total)

    def scaled(self, wrench: Array) -> Array:
        """Return a wrench with moments over the lever [N]."""
        found = wrench.copy()
        found[3:] /= self.lever
        return np.asarray(found)

    def best(self, sides: Array | None = None) -> Array:
        """Return the tangential forces (k, 3) [N] in their cones that leave least of the wrench.

        A convex program with second-order cones; by sequential least squares. In pyramids inside of
        the cones where their sides' normals (m, 2) are given.
        """
        k = len(self.normal)
        most = self.friction * np.maximum(self.normal, 0.0)
        if not k or not most.any():
            return np.zeros((k, 3))
        unit = max(float(np.abs(self.wrench[:3]).max()), float(most.max()))
        still = self.scaled(self.left(np.zeros((k, 3)))) / unit
        columns = []
        for i in range(k):
            for e in self.bases[i].T:
                columns.append(np.concatenate([e, np.cross(self.points[i], e) / self.lever]))
        A = np.array(columns).T[: still.size]
        room = (most / unit) ** 2

        def cost(z: Array) -> float:
            return float(np.sum((still + A @ z) ** 2) / 2 + _COST * z @ z / 2)

        def slope(z: Array) -> Array:
            return np.asarray(A.T @ (still + A @ z) + _COST * z)

        if sides is not None:
            z = self._in_pyramids(A, still, most / unit, sides).reshape(k, 2)
            return np.asarray(unit * np.einsum("kij,kj->ki", self.bases, z))

        def cones(z: Array) -> Array:
            return np.asarray(room - (z.reshape(k, 2) ** 2).sum(axis=1))

        def cone_jacobian(z: Array) -> Array:
            found = np.zeros((k, k, 2))
            found[np.arange(k), np.arange(k)] = -2 * z.reshape(k, 2)
            return found.reshape(k, 2 * k)

        within = {"type": "ineq", "fun": cones, "jac": cone_jacobian}
        given = {"jac": slope, "constraints": within, "method": "SLSQP"}
        found = scipy.optimize.minimize(
            cost, np.zeros(2 * k), **given, options={"ftol": 1e-18, "maxiter": 300}
        )
        z = found.x.reshape(k, 2)
        sizes = np.linalg.norm(z, axis=1)
        z *= np.minimum(1.0, most / unit / np.maximum(sizes, 1e-300))[:, None]
        return np.asarray(unit * np.einsum("kij,kj->ki", self.bases, z))

    @staticmethod
    def _in_pyramids(A: Array, still: Array, most: Array, sides: Array) -> Array:
        """Return tangential forces (2 k,) that leave least of A z + still, to rounding."""
        n, rows = A.shape[1], np.asarray(np.kron(np.eye(most.size), sides), dtype=np.float64)
        inner = np.repeat(most * np.cos(np.pi / len(sides)), len(sides))
        none, free = np.full(inner.size, -np.inf), np.full(n, np.inf)
        H, g = np.asarray(A.T @ A + _LEAST_COST * np.eye(n)), np.asarray(A.T @ still)
        solve = quadratic(n, inner.size, _MISSED)
        return solve(H.ravel(), g, rows.ravel("F"), none, inner, -free, free)[0].ravel()


def axes_across(normals: Array) -> Array:
    """Return of the axes of the base frame those (k, 3) that are farthest from normals (k, 3)."""
    return np.asarray(np.eye(3)[np.argmin(np.abs(normals), axis=1)])


def grips_of(shape: Shape, hold: Hold) -> tuple[Grip, ...]:
    """Return the forces on an object that leave least of the wrench, from base to tip."""
    grasp, centre = Grasp.of(shape, hold), hold.obstacle.numbers[:3]
    pressed = -grasp.normal[:, None] * grasp.normals
    parts = zip(grasp.points + centre, pressed, grasp.best(), strict=True)
    return tuple(Grip(hold.obstacle, *own) for own in parts)


def left_of(arm: Arm, shape: Shape, hold: Hold) -> Array:
    """Return the wrench (3,) or (6,) that contact forces cannot balance [N, N m]."""
    grasp = Grasp.of(shape, hold)
    return grasp.left(grasp.best())


def needed_friction(shape: Shape, hold: Hold, accuracy: float) -> float:
    """Return the least coefficient of friction with which the wrench is balanced, at most 10.

    To three digits, and no more than what is given where that is enough; infinite where none is.
    """
    grasp, low, high = Grasp.of(shape, hold), 0.0, 10.0

    def balanced(mu: float) -> bool:
        own = replace(grasp, friction=mu)
        off = own.scaled(own.left(own.best()))
        return bool(np.linalg.norm(off) <= accuracy * hold.size(shape.arm))

    if not balanced(high):
        return np.inf
    if balanced(hold.friction):
        high = min(high, hold.friction)
    while high - low > 1e-3 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if balanced(middle) else (middle, high)
    return high
