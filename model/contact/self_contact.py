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
from scipy.linalg import null_space

from model.arm import Arm
from model.contact.contacts import Touch
from model.contact.path import stepped
from model.effects import NeoHookean, PointLoad
from model.errors import OctoplanError, UnsettledContactError
from model.obstacles import Sphere
from model.paths import Array
from model.scene import Scene
from model.shape import Shape
from model.time_limit import before_long, check_time

# First, least and longest step in the load factor of the tensions; arc lengths at which gaps are
# sampled.
_STEPS, _SAMPLES = (1 / 4, 1 / 1024, 1 / 4), 200
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
class Gap:
    """The gap between the balls of two cross-sections of a shape, the nearer to the base first.

    Attributes
    ----------
    points : (2, 3)
        Centres of the balls [m].
    radii : (2,)
        [m].
    along : (2, 3)
        Derivatives of the centres by arc length, on the base side, as a point force lets the
        strains jump; by differences of the second order.
    slopes : (2,)
        Derivatives of the gap by either arc length.
    """

    points: Array
    radii: Array
    along: Array
    slopes: Array

    @classmethod
    def at(cls, shape: Shape, s: Array) -> Gap:
        """Return that at arc lengths (2,) [m]."""
        h = np.minimum(_ALONG * shape.arm.length, s / 2)
        stations = (s[:, None] - h[:, None] * np.arange(3.0)).ravel()
        points = shape.position(stations).reshape(2, 3, 3)
        radii = radii_of(shape, stations).reshape(2, 3)
        weights = np.outer(1 / h, [1.5, -2.0, 0.5])
        along = np.einsum("ij,ijk->ik", weights, points)
        away = points[1, 0] - points[0, 0]
        signed = np.array([-1, 1]) * (along @ away) / np.linalg.norm(away)
        return cls(points[:, 0], radii[:, 0], along, signed - (weights * radii).sum(axis=1))

    @property
    def normal(self) -> Array:
        """The unit vector (3,) from the nearer to the farther centre."""
        away = self.points[1] - self.points[0]
        return np.asarray(away / np.linalg.norm(away))

    @property
    def size(self) -> float:
        """The gap [m]."""
        return float(np.linalg.norm(self.points[1] - self.points[0]) - self.radii.sum())


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

    def residual(self, shape: Shape, across: Array) -> Array:
        """Return gap [m], force along two directions `across` (3, 2) [N], two slopes [-]: (5,).

        Directions are made normal to the line that joins the midlines. Slopes are derivatives of
        the gap by the arc lengths; of the farther one, which may be the tip, it is complementary
        to the distance from there.
        """
        gap = Gap.at(shape, self.s)
        normal = across - np.outer(gap.normal, gap.normal @ across)
        left = 1 - self.s[1] / shape.arm.length
        slopes = gap.slopes[0], min(left, -gap.slopes[1])
        return np.array([gap.size, *(self.force @ normal), *slopes])

    def pressed(self, shape: Shape) -> float:
        """Return the force that presses the two apart [N]; below 0 they would pull."""
        return float(self.force @ Gap.at(shape, self.s).normal)

    def sideways(self, shape: Shape) -> Array | None:
        """Return the direction (3,) in which the pair may slip; None where parts cross.

        Normal to the line that joins the midlines, and to the arm. Parts that cross at an angle
        slide along themselves instead, so that the line keeps its direction.
        """
        gap = Gap.at(shape, self.s)
        t, other = gap.along / np.linalg.norm(gap.along, axis=1)[:, None]
        if np.linalg.norm(np.cross(t, other)) > _CROSSING and self.s[1] < shape.arm.length:
            return None
        lateral = np.cross(gap.normal, t)
        return np.asarray(lateral / np.linalg.norm(lateral))

    def touches(self, shape: Shape) -> tuple[Touch, Touch]:
        """Return what either cross-section leans on: the other one's ball."""
        gap = Gap.at(shape, self.s)
        n, (near, far) = gap.normal, gap.points
        below, beyond = map(Sphere, map(tuple, gap.points.tolist()), gap.radii.tolist())
        surfaces = near + gap.radii[0] * n, far - gap.radii[1] * n
        return (
            Touch(beyond, float(self.s[0]), -self.force, gap.size, surfaces[1], -n),
            Touch(below, float(self.s[1]), self.force.copy(), gap.size, surfaces[0], n),
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

    steps = stepped(solve, path.begin(), _STEPS, over)
    assert steps is not None
    shape, pairs = steps[-1][0]
    touches = [touch for pair in pairs for touch in pair.touches(shape)]
    return replace(shape, on_itself=tuple(sorted(touches, key=lambda touch: touch.s)))


class _LoadPath:
    """Equilibria while tensions grow."""

    def __init__(self, tensions: Array, scene: Scene, settle: Settle) -> None:
        self.tensions, self.scene, self._settle = tensions, scene, settle

    def begin(self) -> _State:
        """Return the arm without tensions; raises UnsettledContactError if it meets itself."""
        shape = self._settle(0 * self.tensions, self.scene, None)
        if nearest_pairs(shape)[0]:
            raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
        radius = float(shape.arm.outer_radius(np.zeros(1))[0][0])
        self._force = shape.arm.material.E * radius**4 / shape.arm.length**2
        return shape, ()

    def step(self, state: _State, factor: float) -> _State | None:
        """Return the equilibrium at a load factor; None if the step was too long."""
        near, pairs = state
        for _ in range(_CHANGES):
            try:
                solution = self._closed(factor, pairs, near)
            except OctoplanError:
                return None
            if solution is None or _passes(state[0], solution[0]):
                return None
            near, pairs = solution
            forces = [pair.pressed(near) for pair in pairs]
            if forces and min(forces) < 0:
                k = int(np.argmin(forces))
                pairs = (*pairs[:k], *pairs[k + 1 :])
                continue
            new = [pair for pair in nearest_pairs(near)[0] if _is_new(pair, pairs, near)]
            if not new:
                return near, pairs
            pairs = (*pairs, new[0])
        return None

    def _closed(self, factor: float, pairs: tuple[Pair, ...], near: Shape) -> _State | None:
        """Return the equilibrium with pairs closed near a shape; None where there is no root.

        Unknowns are forces, arc lengths of the nearer cross-sections, and the distances of the
        farther ones from the tip, scaled.
        """
        if not pairs:
            return self._settle(factor * self.tensions, self.scene, near), ()
        arm, last = near.arm, (near, pairs)
        across = [null_space(Gap.at(near, pair.s).normal[None]) for pair in pairs]
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

        def jacobian(z: Array) -> Array:
            return np.asarray(scipy.optimize.approx_fprime(z, residual, _DIFFERENCE))

        z = [
            [*(p.force / self._force), p.s[0] / arm.length, 1 - p.s[1] / arm.length] for p in pairs
        ]
        options = {"xtol": 1e-11, "factor": 0.1, "col_deriv": False}
        end = scipy.optimize.root(
            residual, np.ravel(z), jac=jacobian, method="hybr", options=options
        ).x.reshape(-1, 5)
        end[:, 4] *= end[:, 4] > _ROOT
        off = np.abs(residual(end.ravel())).max()
        return last if off < _ROOT else None

    def slips(self, state: _State, factor: float) -> bool:
        """Return whether a pair slips off sideways, other forces held.

        It does where the force, which rotates with the line that joins the midlines, grows faster
        than the arm's resistance: P > K d, with d the distance of the midlines.
        """
        shape, pairs = state
        for k, pair in enumerate(pairs):
            across = pair.sideways(shape)
            if across is None:
                continue
            push = _PUSH * max(pair.pressed(shape), _PUSH * self._force)
            pushed = replace(pair, force=pair.force + push * across)
            scene = loaded_by(shape.arm, self.scene, (*pairs[:k], pushed, *pairs[k + 1 :]))
            there = self._settle(factor * self.tensions, scene, shape)
            before, after = (np.subtract(*at.position(pair.s)[::-1]) for at in (shape, there))
            compliance = float(across @ (after - before)) / push
            if compliance < 0 or pair.pressed(shape) * compliance > np.linalg.norm(before):
                return True
        return False


def _passes(before: Shape, after: Shape) -> bool:
    """Return whether parts that were apart may be deep in each other, or beyond."""
    L, s = after.arm.length, np.linspace(0.0, after.arm.length, _SAMPLES + 1)[1:]
    far = float(np.linalg.norm(after.position(s) - before.position(s), axis=1).max())
    deep = _DEEP * float(after.arm.outer_radius(s)[0].min())
    apart = max(nearest_pairs(before)[1], 0.0)
    return nearest_pairs(after)[1] < -deep or far > max(L / 10, apart / 2 + deep)


def _is_new(pair: Pair, pairs: Sequence[Pair], shape: Shape) -> bool:
    """Return whether a pair of cross-sections inside of each other is a new one."""
    L = shape.arm.length
    is_old = any(np.abs(other.s - pair.s).max() < _OTHER * L for other in pairs)
    return not is_old and Gap.at(shape, pair.s).size < -_THROUGH * L
