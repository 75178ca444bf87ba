"""Pairs of places at which an arm presses on itself: gaps, forces and what these leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.contact.contacts import Touch
from model.effects import NeoHookean, PointLoad
from model.obstacles import Sphere
from model.paths import Array
from model.scene import Scene
from model.shape import Shape

# Steps of differences along the arm, over its length.
_STEP = 1e-4
# Of parts that cross: the sine of the angle between them.
_CROSSING = 0.1


@dataclass(frozen=True, eq=False)
class Pair:
    """Two places that press on each other.

    Attributes
    ----------
    s : (2,)
        Arc lengths, the nearer to the base first [m].
    force : (3,)
        On the farther one, base frame [N]; its opposite is on the nearer one.
    at_tip : bool
        Whether the farther one is the tip.
    """

    s: Array
    force: Array
    at_tip: bool

    @property
    def unknowns(self) -> Array:
        """Force [N], then arc lengths [m] that are free, (4,) or (5,)."""
        return np.concatenate([self.force, self.s[: 1 if self.at_tip else 2]])

    def at(self, unknowns: Array) -> Pair:
        """Return the pair with other unknowns."""
        return replace(self, force=unknowns[:3], s=np.append(unknowns[3:], self.s[1:])[:2])

    def gap(self, shape: Shape) -> float:
        """Return the gap between the two surfaces [m]."""
        near, far = (Ball.at(shape, s) for s in self.s)
        return float(np.linalg.norm(far.centre - near.centre)) - near.radius - far.radius

    def residual(self, shape: Shape, across: Array) -> Array:
        """Return what vanishes where the pair is in equilibrium (4,) or (5,).

        The gap [m], the force along two directions `across` (3, 2), made normal to the line that
        joins the midlines [N]; the derivatives of the gap by the arc lengths that are free.
        """
        near, far = (Ball.at(shape, s) for s in self.s)
        away = far.centre - near.centre
        distance = float(np.linalg.norm(away))
        n = away / distance
        normal = across - np.outer(n, n @ across)
        slopes = [-n @ near.along - near.widening, n @ far.along - far.widening]
        gap = distance - near.radius - far.radius
        return np.array([gap, *(self.force @ normal), *slopes[: 1 if self.at_tip else 2]])

    def pressed(self, shape: Shape) -> float:
        """Return the force that presses the two apart [N]; below 0 they would pull."""
        near, far = shape.position(self.s)
        return float(self.force @ (far - near) / np.linalg.norm(far - near))

    def sideways(self, shape: Shape) -> Array | None:
        """Return the direction (3,) in which the pair may slip; None where parts cross.

        Normal to the line that joins the midlines, and to the arm. Parts that cross at an angle
        slide along themselves instead, so that the line keeps its direction.
        """
        near, far = (Ball.at(shape, s) for s in self.s)
        t, other = near.along, far.along
        crossing = np.linalg.norm(np.cross(t, other)) / np.linalg.norm(t) / np.linalg.norm(other)
        if crossing > _CROSSING and not self.at_tip:
            return None
        found = np.cross(far.centre - near.centre, t)
        return np.asarray(found / np.linalg.norm(found))

    def touches(self, shape: Shape) -> tuple[Touch, Touch]:
        """Return what either place leans on: the other one's ball."""
        near, far = (Ball.at(shape, s) for s in self.s)
        n = (far.centre - near.centre) / np.linalg.norm(far.centre - near.centre)
        gap = self.gap(shape)
        surfaces = near.centre + near.radius * n, far.centre - far.radius * n
        bodies = (Sphere(tuple(own.centre.tolist()), own.radius) for own in (near, far))
        below, beyond = bodies
        return (
            Touch(beyond, float(self.s[0]), -self.force, gap, surfaces[1]),
            Touch(below, float(self.s[1]), self.force.copy(), gap, surfaces[0]),
        )


@dataclass(frozen=True, eq=False)
class Ball:
    """The ball of a place: centre (3,) and radius [m], and their derivatives by arc length [-].

    On the base side, where a point force lets the strains jump.
    """

    centre: Array
    radius: float
    along: Array
    widening: float

    @classmethod
    def at(cls, shape: Shape, s: float) -> Ball:
        """Return that of an arc length [m], by differences of the second order."""
        h = min(_STEP * shape.arm.length, s / 2)
        places = s - h * np.arange(3.0)
        points, radii = shape.position(places), radii_of(shape, places)
        weights = np.array([1.5, -2.0, 0.5]) / h
        return cls(points[0], float(radii[0]), weights @ points, float(weights @ radii))


def radii_of(shape: Shape, s: Array) -> Array:
    """Return the radii (N,) of the settled body at arc lengths s (N,) [m]."""
    radii = shape.arm.outer_radius(s)[0]
    if shape.scene.has(NeoHookean):
        radii = radii / np.sqrt(1 + shape.strains(s)[:, 3])
    return np.asarray(radii)


def loaded_by(arm: Arm, scene: Scene, pairs: Sequence[Pair]) -> Scene:
    """Return the scene with the forces of pairs as point loads."""
    forces = {own.s: np.array(own.force) for own in scene.effects if isinstance(own, PointLoad)}
    for pair in pairs:
        for s, sign in zip(pair.s.tolist(), (-1.0, 1.0), strict=True):
            place = min(s, arm.length)
            forces[place] = forces.get(place, 0.0) + sign * pair.force
    rest = (own for own in scene.effects if not isinstance(own, PointLoad))
    return Scene(*rest, *(PointLoad(s, tuple(f.tolist())) for s, f in sorted(forces.items())))


def nearest_pairs(shape: Shape, looks: int) -> tuple[list[Pair], float]:
    """Return pairs without force where the gap is least and below 0, and the least gap of all [m].

    Of places between which the arm has turned by half a turn, as clearances have it; infinite where
    there are none. Looked for among so many places.
    """
    L = shape.arm.length
    s = np.linspace(0.0, L, looks + 1)[1:]
    points, radii = shape.position(s), radii_of(shape, s)
    along = np.diff(points, axis=0, prepend=shape.position(0.0)[None])
    along /= np.linalg.norm(along, axis=1)[:, None]
    angles = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1, 1))
    turned = np.append(0.0, np.cumsum(angles))
    gap = np.linalg.norm(points[:, None] - points, axis=2) - radii[:, None] - radii
    gap[turned[None, :] - turned[:, None] < np.pi] = np.inf
    wide = np.pad(gap, 1, constant_values=np.inf)
    around = [np.roll(wide, (i, j), (0, 1))[1:-1, 1:-1] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    lowest = (gap <= np.min(around, axis=0)) & (gap < 0)
    found = [
        Pair(np.array([s[i], s[j]]), np.zeros(3), bool(j == looks - 1))
        for i, j in zip(*np.nonzero(lowest), strict=True)
    ]
    return found, float(gap.min())
