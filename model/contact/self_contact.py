"""An arm that presses on itself: tensions grow from none, pairs of cross-sections come and go.

The equilibrium with some pairs closed: the forces at a pair act as point loads; these and the arc
lengths are the roots, by MINPACK's hybrid method (Powell, in Rabinowitz, "Numerical Methods for
Nonlinear Algebraic Equations", 1970), of gaps, transverse forces and derivatives of the gaps, over
settled shapes. Steps in the tensions are so short that parts that are apart cannot pass through
each other within one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.linalg import null_space

from model.arm import Arm
from model.contact.contacts import Touch
from model.effects import NeoHookean, PointLoad
from model.errors import OctoplanError, UnsettledContactError
from model.obstacles import Sphere
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.shape import Shape
from model.time_limit import PATIENCE, OutOfTime, check_time, unless

# First and least step in the load factor of the tensions; arc lengths at which gaps are sampled.
_FIRST, _LEAST, _SAMPLES = 0.25, 1 / 1024, 200
# Penetration that is allowed when a pair begins, over the lesser radius, and when it is closed,
# over the length; how far apart arc lengths are another pair's, over the length.
_DEEP, _THROUGH, _OTHER = 0.5, 1e-9, 0.03
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
class Ball:
    """The ball of a cross-section: centre (3,) and radius [m], their derivatives by s [-].

    On the base side, as a point force lets the strains jump.
    """

    centre: Array
    radius: float
    along: Array
    widening: float

    @classmethod
    def at(cls, shape: Shape, s: float) -> Ball:
        """Return that of an arc length [m], by differences of the second order."""
        h = min(_ALONG * shape.arm.length, s / 2)
        stations = s - h * np.arange(3.0)
        points, radii = shape.position(stations), radii_of(shape, stations)
        weights = np.array([1.5, -2.0, 0.5]) / h
        return cls(points[0], float(radii[0]), weights @ points, float(weights @ radii))


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

    def balls(self, shape: Shape) -> tuple[Ball, Ball, Array, float]:
        """Return the balls of both, the unit vector (3,) between their centres, the gap [m]."""
        near, far = (Ball.at(shape, s) for s in self.s)
        away = far.centre - near.centre
        distance = float(np.linalg.norm(away))
        return near, far, away / distance, distance - near.radius - far.radius

    def residual(self, shape: Shape, across: Array) -> Array:
        """Return gap [m], force along two directions `across` (3, 2) [N], two slopes [-]: (5,).

        Directions are made normal to the line that joins the midlines. Slopes are derivatives of
        the gap by the arc lengths; of the farther one, which may be the tip, it is complementary
        to the distance from there.
        """
        near, far, n, gap = self.balls(shape)
        normal = across - np.outer(n, n @ across)
        slopes = -n @ near.along - near.widening, n @ far.along - far.widening
        left = 1 - self.s[1] / shape.arm.length
        return np.array([gap, *(self.force @ normal), slopes[0], min(left, -slopes[1])])

    def pressed(self, shape: Shape) -> float:
        """Return the force that presses the two apart [N]; below 0 they would pull."""
        near, far = shape.position(self.s)
        return float(self.force @ (far - near) / np.linalg.norm(far - near))

    def sideways(self, shape: Shape) -> Array | None:
        """Return the direction (3,) in which the pair may slip; None where parts cross.

        Normal to the line that joins the midlines, and to the arm. Parts that cross at an angle
        slide along themselves instead, so that the line keeps its direction.
        """
        near, far, n, _ = self.balls(shape)
        t, other = near.along, far.along
        crossing = np.linalg.norm(np.cross(t, other)) / np.linalg.norm(t) / np.linalg.norm(other)
        if crossing > _CROSSING and self.s[1] < shape.arm.length:
            return None
        lateral = np.cross(n, t)
        return np.asarray(lateral / np.linalg.norm(lateral))

    def touches(self, shape: Shape) -> tuple[Touch, Touch]:
        """Return what either cross-section leans on: the other one's ball."""
        near, far, n, gap = self.balls(shape)
        below, beyond = (Sphere(tuple(ball.centre.tolist()), ball.radius) for ball in (near, far))
        surfaces = near.centre + near.radius * n, far.centre - far.radius * n
        return (
            Touch(beyond, float(self.s[0]), -self.force, gap, surfaces[1], -n),
            Touch(below, float(self.s[1]), self.force.copy(), gap, surfaces[0], n),
        )


def radii_of(shape: Shape, s: Array) -> Array:
    """Return the radii (N,) of the settled body at arc lengths s (N,) [m]."""
    radii = shape.arm.outer_radius(s)[0]
    if shape.scene.has(NeoHookean):
        radii = radii / np.sqrt(1 + shape.strains(s)[:, 3])
    return np.asarray(radii)


def loaded_by(arm: Arm, scene: Scene, pairs: Sequence[Pair]) -> Scene:
    """Return the scene with the forces of pairs as point loads."""
    forces = {load.s: np.array(load.force) for load in scene.effects if isinstance(load, PointLoad)}
    for pair in pairs:
        for s, sign in zip(pair.s.tolist(), (-1.0, 1.0), strict=True):
            at = min(s, arm.length)
            forces[at] = forces.get(at, 0.0) + sign * pair.force
    rest = (effect for effect in scene.effects if not isinstance(effect, PointLoad))
    return Scene(*rest, *(PointLoad(s, tuple(f.tolist())) for s, f in sorted(forces.items())))


def nearest_pairs(shape: Shape) -> tuple[list[Pair], float]:
    """Return pairs without force where the gap is least and below 0, and the least gap of all [m].

    Of cross-sections between which the arm has turned by half a turn, as clearances have it;
    infinite where there are none.
    """
    L = shape.arm.length
    s = np.linspace(0.0, L, _SAMPLES + 1)[1:]
    points, radii = shape.position(s), radii_of(shape, s)
    along = np.diff(points, axis=0, prepend=shape.position(0.0)[None])
    along /= np.linalg.norm(along, axis=1)[:, None]
    angles = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1, 1))
    turned = np.append(0.0, np.cumsum(angles))
    gap = np.linalg.norm(points[:, None] - points, axis=2) - radii[:, None] - radii
    gap[turned[None, :] - turned[:, None] < np.pi] = np.inf
    wide = np.pad(gap, 1, constant_values=np.inf)
    around = [np.roll(wide, (i, j), (0, 1))[1:-1, 1:-1] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    lowest = np.argwhere((gap <= np.min(around, axis=0)) & (gap < 0))
    return [Pair(s[at], np.zeros(3)) for at in lowest], float(gap.min())


@dataclass(frozen=True, eq=False)
class _State:
    """An equilibrium, the pairs that are closed, and the least gap [m]."""

    shape: Shape
    pairs: tuple[Pair, ...]
    least: float


def pressed_on_itself(tensions: Array, scene: Scene, settle: Settle) -> Shape:
    """Return the shape of an arm whose parts press on each other, in the scene without that.

    Raises UnsettledContactError where none is found, and what `settle` does.
    """
    path = _LoadPath(tensions, scene, settle)
    try:
        with unless(path.is_late):
            state = _followed(path)
    except OutOfTime:
        check_time()
        late = f"none is found within {PATIENCE:g} s"
        raise UnsettledContactError(path.factor, late) from None
    touches = [touch for pair in state.pairs for touch in pair.touches(state.shape)]
    return replace(state.shape, on_itself=tuple(sorted(touches, key=lambda touch: touch.s)))


def _followed(path: _LoadPath) -> _State:
    """Return the equilibrium at the end of a load path; raises what pressed_on_itself does."""
    state, factor, step = path.begin(), 0.0, _FIRST
    while factor < 1:
        check_time()
        tell("percent of tensions", round(100 * factor), 100)
        after = min(1.0, factor + step)
        there = path.step(state, after)
        if there is not None and path.slips(there, after):
            sentence = (
                "parts that press on each other slip past each other sideways; a little tension "
            )
            raise UnsettledContactError(after, sentence + "across decides to which side")
        if there is not None:
            state, factor, step = there, after, min(2 * step, _FIRST)
            path.reach(factor)
        elif step > _LEAST:
            step /= 2
        else:
            raise UnsettledContactError(factor, "where it presses on itself is not found")
    return state


class _LoadPath:
    """The equilibrium followed while tensions grow."""

    def __init__(self, tensions: Array, scene: Scene, settle: Settle) -> None:
        self.tensions, self.scene, self._settle = tensions, scene, settle
        self.reach(0.0)

    def reach(self, factor: float) -> None:
        """Note the load factor that is reached, and when."""
        self.factor, self._reached = factor, time.process_time()

    def is_late(self) -> bool:
        """Whether the last progress is too long ago."""
        return time.process_time() > self._reached + PATIENCE

    def begin(self) -> _State:
        """Return the arm without tensions; raises UnsettledContactError if it meets itself."""
        shape = self._settle(0 * self.tensions, self.scene, None)
        pairs, least = nearest_pairs(shape)
        if pairs:
            raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
        radius = float(shape.arm.outer_radius(np.zeros(1))[0][0])
        self._force = shape.arm.material.E * radius**4 / shape.arm.length**2
        return _State(shape, (), least)

    def step(self, state: _State, factor: float) -> _State | None:
        """Return the equilibrium at a load factor; None if the step was too long."""
        pairs, near = state.pairs, state.shape
        for _ in range(_CHANGES):
            try:
                solution = self._closed(factor, pairs, near)
            except OctoplanError:
                return None
            if solution is None or self._passes(state, solution[0]):
                return None
            near, pairs = solution
            forces = [pair.pressed(near) for pair in pairs]
            if forces and min(forces) < 0:
                k = int(np.argmin(forces))
                pairs = (*pairs[:k], *pairs[k + 1 :])
                continue
            lowest, least = nearest_pairs(near)
            new = [pair for pair in lowest if self._is_new(pair, pairs, near)]
            if not new:
                return _State(near, pairs, least)
            pairs = (*pairs, new[0])
        return None

    def _closed(
        self, factor: float, pairs: tuple[Pair, ...], near: Shape
    ) -> tuple[Shape, tuple[Pair, ...]] | None:
        """Return the equilibrium with pairs closed near a shape; None where there is no root.

        Unknowns are forces, arc lengths of the nearer cross-sections, and the distances of the
        farther ones from the tip, scaled.
        """
        if not pairs:
            return self._settle(factor * self.tensions, self.scene, near), ()
        arm, last = near.arm, (near, pairs)
        across = [null_space(np.subtract(*near.position(pair.s)[::-1])[None]) for pair in pairs]
        scale = np.array([arm.length, self._force, self._force, 1.0, 1.0])

        def residual(z: Array) -> Array:
            nonlocal last
            check_time()
            now = tuple(
                Pair(arm.length * np.clip([row[3], 1 - row[4]], _ALONG, 1), self._force * row[:3])
                for row in z.reshape(-1, 5)
            )
            shape = self._settle(factor * self.tensions, loaded_by(arm, self.scene, now), last[0])
            last = shape, now
            rows = [p.residual(shape, e) / scale for p, e in zip(now, across, strict=True)]
            beyond = np.minimum(z.reshape(-1, 5)[:, 4], 0.0)
            return np.concatenate(rows) + np.outer(beyond, np.eye(5)[4]).ravel()

        z = np.array(
            [
                [*(p.force / self._force), p.s[0] / arm.length, 1 - p.s[1] / arm.length]
                for p in pairs
            ]
        )

        def jacobian(z: Array) -> Array:
            return np.asarray(scipy.optimize.approx_fprime(z, residual, _DIFFERENCE))

        options = {"xtol": 1e-11, "factor": 0.1, "col_deriv": False}
        solution = scipy.optimize.root(
            residual, z.ravel(), jac=jacobian, method="hybr", options=options
        )
        z = solution.x.reshape(-1, 5)
        z[:, 4] *= z[:, 4] > _ROOT
        off = np.abs(residual(z.ravel())).max()
        return last if off < _ROOT else None

    def slips(self, state: _State, factor: float) -> bool:
        """Return whether a pair slips off sideways, other forces held.

        It does where the force, which rotates with the line that joins the midlines, grows faster
        than the arm's resistance: P > K d, with d the distance of the midlines.
        """
        for k, pair in enumerate(state.pairs):
            across = pair.sideways(state.shape)
            if across is None:
                continue
            push = _PUSH * max(pair.pressed(state.shape), _PUSH * self._force)
            pushed = replace(pair, force=pair.force + push * across)
            pairs = (*state.pairs[:k], pushed, *state.pairs[k + 1 :])
            scene = loaded_by(state.shape.arm, self.scene, pairs)
            there = self._settle(factor * self.tensions, scene, state.shape)
            before, after = (
                np.subtract(*shape.position(pair.s)[::-1]) for shape in (state.shape, there)
            )
            compliance = float(across @ (after - before)) / push
            most = np.linalg.norm(before)
            if compliance < 0 or pair.pressed(state.shape) * compliance > most:
                return True
        return False

    def _passes(self, state: _State, shape: Shape) -> bool:
        """Return whether parts that were apart may be deep in each other, or beyond."""
        s = np.linspace(0.0, shape.arm.length, _SAMPLES + 1)[1:]
        far = float(np.linalg.norm(shape.position(s) - state.shape.position(s), axis=1).max())
        deep = _DEEP * float(shape.arm.outer_radius(s)[0].min())
        if not np.isfinite(state.least):
            # Nothing had turned by half a turn: it may have since, but not be deep.
            return nearest_pairs(shape)[1] < -deep
        return 2 * far > max(state.least, 0.0) + 2 * deep and (
            nearest_pairs(shape)[1] < -deep or far > shape.arm.length / 10
        )

    def _is_new(self, pair: Pair, pairs: Sequence[Pair], shape: Shape) -> bool:
        """Return whether a pair of cross-sections inside of each other is a new one."""
        L = shape.arm.length
        is_old = any(np.abs(other.s - pair.s).max() < _OTHER * L for other in pairs)
        return not is_old and pair.balls(shape)[3] < -_THROUGH * L
