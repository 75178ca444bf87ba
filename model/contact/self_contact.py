"""An arm that presses on itself: tensions grow from none, pairs of cross-sections come and go.

The equilibrium with some pairs closed: the forces at a pair act as point loads; these and the arc
lengths are the roots, by MINPACK's hybrid method (Powell, in Rabinowitz, "Numerical Methods for
Nonlinear Algebraic Equations", 1970), of gaps, transverse forces and derivatives of the gaps, over
settled shapes. Steps in the tensions are so short that parts that are apart cannot pass through
each other within one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from model.arm import Arm
from model.centreline import Centreline
from model.clearance.nearest import ITSELF, clearances
from model.contact.contacts import Touch
from model.contact.gaps import THROUGH
from model.contact.path import stepped
from model.effects import NeoHookean, PointLoad
from model.errors import OctoplanError, UnsettledContactError
from model.obstacles import Sphere
from model.paths import Array
from model.scene import Scene
from model.shape import Shape
from model.time_limit import before_long, check_time

# First, least and longest step in the load factor of the tensions.
_STEPS = 1 / 4, 1 / 1024, 1 / 4
# Penetration that is allowed when a pair begins, over the lesser radius; how far apart arc lengths
# are another pair's, over the length.
_DEEP, _OTHER = 0.5, 0.03
# How often pairs come and go at one load factor; residuals of a root, scaled.
_CHANGES, _ROOT = 8, 2e-10
# Steps of differences: along the arm, over its length; of scaled unknowns; of a lateral force, over
# that of a pair.
_ALONG, _DIFFERENCE, _PUSH = 1e-4, 1e-5, 1e-3
# The sine of the angle between parts that cross.
_CROSSING = 0.1

# Tensions (n_tendons,), a scene, a shape nearby -> the shape.
Settle = Callable[[Array, Scene, Shape | None], Shape]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two cross-sections that press on each other.

    Attributes
    ----------
    s : (2,)
        Arc lengths, the nearer to the base first [m].
    force : (3,)
        On the farther one, base frame [N]; its opposite is on the nearer one.
    """

    s: Array
    force: Array


@dataclass(frozen=True, eq=False)
class Gap:
    """The gap between the balls of two cross-sections of a shape, the nearer to the base first.

    Attributes
    ----------
    size : float
        [m].
    points : (2, 3)
        Centres of the balls [m].
    radii : (2,)
        Those of the settled body [m].
    normal : (3,)
        The unit vector from the nearer to the farther centre.
    along : (2, 3)
        Derivatives of the centres by arc length, on the base side, as a point force lets the
        strains jump; by differences of the second order.
    slopes : (2,)
        Derivatives of the gap by either arc length.
    """

    size: float
    points: Array
    radii: Array
    normal: Array
    along: Array
    slopes: Array

    @classmethod
    def at(cls, shape: Shape, s: Array) -> Gap:
        """Return that at arc lengths (2,) [m]."""
        h = np.minimum(_ALONG * shape.arm.length, s / 2)
        stations = s[:, None] - h[:, None] * np.arange(3.0)
        points = shape.position(stations.ravel()).reshape(2, 3, 3)
        radii = shape.arm.outer_radius(stations.ravel())[0].reshape(2, 3)
        if shape.scene.has(NeoHookean):
            radii = radii / np.sqrt(1 + shape.strains(stations.ravel())[:, 3].reshape(2, 3))
        weights = np.outer(1 / h, [1.5, -2.0, 0.5])
        along = np.einsum("ij,ijk->ik", weights, points)
        away = points[1, 0] - points[0, 0]
        distance = float(np.linalg.norm(away))
        normal = away / distance
        slopes = np.array([-1, 1]) * (along @ normal) - (weights * radii).sum(axis=1)
        gap = distance - float(radii[:, 0].sum())
        return cls(gap, points[:, 0], radii[:, 0], normal, along, slopes)


def loaded_by(arm: Arm, scene: Scene, pairs: Sequence[Pair]) -> Scene:
    """Return the scene with the forces of pairs as point loads."""
    forces = {load.s: np.array(load.force) for load in scene.effects if isinstance(load, PointLoad)}
    for pair in pairs:
        for s, sign in zip(pair.s.tolist(), (-1.0, 1.0), strict=True):
            at = min(s, arm.length)
            forces[at] = forces.get(at, 0.0) + sign * pair.force
    rest = (effect for effect in scene.effects if not isinstance(effect, PointLoad))
    return Scene(*rest, *(PointLoad(s, tuple(f.tolist())) for s, f in sorted(forces.items())))


def nearest_pair(shape: Shape) -> tuple[Pair | None, float]:
    """Return the pair, without force, between which the gap is least, and that gap [m].

    None, and infinite, where no parts of the arm can meet.
    """
    nearest = clearances(Centreline.of(shape), (), {ITSELF})[ITSELF]
    pair = Pair(np.sort(nearest.s), np.zeros(3)) if nearest.s else None
    return pair, nearest.gap


def touches_of_pair(shape: Shape, pair: Pair) -> tuple[Touch, Touch]:
    """Return what either cross-section of a pair leans on: the other one's ball."""
    gap = Gap.at(shape, pair.s)
    n, (near, far), (r_near, r_far) = gap.normal, gap.points, gap.radii.tolist()
    below, beyond = Sphere(tuple(near.tolist()), r_near), Sphere(tuple(far.tolist()), r_far)
    return (
        Touch(beyond, float(pair.s[0]), -pair.force, gap.size, far - r_far * n, -n),
        Touch(below, float(pair.s[1]), pair.force.copy(), gap.size, near + r_near * n, n),
    )


# An equilibrium, and the pairs that are closed.
_State = tuple[Shape, tuple[Pair, ...]]


def pressed_on_itself(tensions: Array, scene: Scene, settle: Settle) -> Shape:
    """Return the shape of an arm whose parts press on each other, in the scene without that.

    Raises UnsettledContactError where none is found, and what `settle` does.
    """
    path = _LoadPath(tensions, scene, settle)

    def solve(factor: float, near: _State) -> _State | None:
        with before_long(factor):
            there = path.step(near, factor)
            if there is not None and path.slips(there, factor):
                sentence = "parts that press on each other slip past each other sideways; a little "
                raise UnsettledContactError(
                    factor, sentence + "tension across decides to which side"
                )
        return there

    def over(before: float, factor: float, near: _State) -> _State:
        raise UnsettledContactError(before, "where it presses on itself is not found")

    shape, pairs = stepped(solve, path.begin(), _STEPS, over)[-1][0]
    touches = [touch for pair in pairs for touch in touches_of_pair(shape, pair)]
    return replace(shape, on_itself=tuple(sorted(touches, key=lambda touch: touch.s)))


class _LoadPath:
    """Equilibria while tensions grow."""

    def __init__(self, tensions: Array, scene: Scene, settle: Settle) -> None:
        self.tensions, self.scene, self._settle = tensions, scene, settle

    def begin(self) -> _State:
        """Return the arm without tensions; raises UnsettledContactError if it meets itself."""
        shape = self._settle(0 * self.tensions, self.scene, None)
        if nearest_pair(shape)[1] < 0:
            raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
        radius = float(shape.arm.outer_radius(np.zeros(1))[0][0])
        self._force = shape.arm.material.E * radius**4 / shape.arm.length**2
        return shape, ()

    def step(self, state: _State, factor: float) -> _State | None:
        """Return the equilibrium at a load factor; None if the step was too long."""
        before, pairs = near, _ = state
        for _ in range(_CHANGES):
            try:
                solution = self._closed(factor, pairs, near)
            except OctoplanError:
                return None
            if solution is None or _passes(before, solution[0]):
                return None
            near, pairs = solution
            pressed = [float(pair.force @ Gap.at(near, pair.s).normal) for pair in pairs]
            if min(pressed, default=0.0) < 0:
                pairs = tuple(pair for k, pair in enumerate(pairs) if k != np.argmin(pressed))
                continue
            new = nearest_pair(near)[0]
            if new is None or not _is_new(new, pairs, near):
                return near, pairs
            pairs = (*pairs, new)
        return None

    def _closed(self, factor: float, pairs: tuple[Pair, ...], near: Shape) -> _State | None:
        """Return the equilibrium with pairs closed near a shape; None where there is no root.

        Unknowns are forces, arc lengths of the nearer cross-sections, and the distances of the
        farther ones from the tip, scaled. Residuals are the gap along the normal of a pair and the
        force across it, and the gap's slopes: that by the farther arc length, which may be the
        tip's, is complementary to the distance from there.
        """
        if not pairs:
            return self._settle(factor * self.tensions, self.scene, near), ()
        L, last = near.arm.length, (near, pairs)

        def residual(z: Array) -> Array:
            nonlocal last
            check_time()
            rows = z.reshape(-1, 5)
            s = L * np.clip(np.column_stack([rows[:, 3], 1 - rows[:, 4]]), _ALONG, 1)
            now = tuple(map(Pair, s, self._force * rows[:, :3]))
            scene = loaded_by(near.arm, self.scene, now)
            shape = self._settle(factor * self.tensions, scene, last[0])
            last, results = (shape, now), list[list[float]]()
            for row, at in zip(rows, s, strict=True):
                gap = Gap.at(shape, at)
                across = row[:3] - gap.normal * (gap.normal @ row[:3])
                slope = min(row[4], -gap.slopes[1])
                results.append([*(across + gap.normal * gap.size / L), gap.slopes[0], slope])
            return np.ravel(results)

        z = [[*(pair.force / self._force), pair.s[0] / L, 1 - pair.s[1] / L] for pair in pairs]
        end = scipy.optimize.root(
            residual,
            np.ravel(z),
            jac=lambda z: np.asarray(scipy.optimize.approx_fprime(z, residual, _DIFFERENCE)),
            options={"xtol": 1e-11, "factor": 0.1},
        ).x.reshape(-1, 5)
        end[:, 4] *= end[:, 4] > _ROOT
        return last if np.abs(residual(end.ravel())).max() < _ROOT else None

    def slips(self, state: _State, factor: float) -> bool:
        """Return whether a pair slips off sideways, other forces held.

        It does where the force, which rotates with the line that joins the midlines, grows faster
        than the arm's resistance: P > K d, with d the distance of the midlines. Sideways is normal
        to that line and to the arm. Parts that cross at an angle slide along themselves instead, so
        that the line keeps its direction.
        """
        shape, pairs = state
        for k, pair in enumerate(pairs):
            gap = Gap.at(shape, pair.s)
            t, other = gap.along / np.linalg.norm(gap.along, axis=1)[:, None]
            across, pressed = np.cross(gap.normal, t), float(pair.force @ gap.normal)
            across /= np.linalg.norm(across)
            if np.linalg.norm(np.cross(t, other)) > _CROSSING and pair.s[1] < shape.arm.length:
                continue
            push = _PUSH * max(pressed, _PUSH * self._force)
            pushed = replace(pair, force=pair.force + push * across)
            scene = loaded_by(shape.arm, self.scene, (*pairs[:k], pushed, *pairs[k + 1 :]))
            there = self._settle(factor * self.tensions, scene, shape)
            before, after = (np.subtract(*at.position(pair.s)[::-1]) for at in (shape, there))
            compliance = float(across @ (after - before)) / push
            if compliance < 0 or pressed * compliance > np.linalg.norm(before):
                return True
        return False


def _passes(before: Shape, after: Shape) -> bool:
    """Return whether parts that were apart may be deep in each other, or beyond."""
    L, s = after.arm.length, after.s[1:]
    far = float(np.linalg.norm(after.position(s) - before.position(s), axis=1).max())
    deep = _DEEP * float(after.arm.outer_radius(s)[0].min())
    apart = max(nearest_pair(before)[1], 0.0)
    return nearest_pair(after)[1] < -deep or far > max(L / 10, apart / 2 + deep)


def _is_new(pair: Pair, pairs: Sequence[Pair], shape: Shape) -> bool:
    """Return whether a pair of cross-sections that are inside of each other is a new one."""
    L = shape.arm.length
    is_old = any(np.abs(other.s - pair.s).max() < _OTHER * L for other in pairs)
    return not is_old and Gap.at(shape, pair.s).size < -THROUGH * L
