"""An arm that presses on itself: tensions grow from none, pairs of cross-sections come and go.

The equilibrium with some pairs closed: the forces at a pair act as point loads; these and the arc
lengths are the roots, by MINPACK's hybrid method (Powell, in Rabinowitz, "Numerical Methods for
Nonlinear Algebraic Equations", 1970), of gaps, transverse forces and derivatives of the gaps, over
settled shapes. Steps in the tensions are so short that parts that are apart cannot pass through
each other within one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from octoplan.model.effects import PointLoad
from octoplan.model.equilibrium.linearised import AnyEquilibrium
from octoplan.model.extensions.clearance.nearest import from_itself
from octoplan.model.extensions.contact.effects import without_self_contact
from octoplan.model.extensions.contact.gaps import THROUGH
from octoplan.model.extensions.contact.path import EXCHANGES, stepped
from octoplan.model.extensions.contact.touches import ContactPoint
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.forward import ForwardMap, forward_maps
from octoplan.model.loads import check_loads, is_coupled
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import SettlingProblem, settle_on_meshes
from octoplan.model.shape import Shape
from octoplan.model.support.errors import (
    Described,
    InputError,
    OctoplanError,
    UnsettledContactError,
)
from octoplan.model.support.progress import check_time, timeout

# First, least and longest step in the load factor of the tensions.
_STEPS = 1 / 4, 1 / 1024, 1 / 4
# Steps of differences: along the arm, over its length, and of scaled unknowns.
_ALONG = 1e-4
# The sine of the angle between parts that cross.
_CROSSING = 0.1

# Tensions (n_tendons,), a scene, a shape nearby -> the shape.
Settle = Callable[[Array, Scene, Shape | None], Shape]


class Pair(NamedTuple):
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


class Gap(NamedTuple):
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
        points, radii = (each.reshape(2, 3, -1) for each in shape.centreline().at(stations.ravel()))
        weights = np.outer(1 / h, [1.5, -2.0, 0.5])
        along, widening = (np.einsum("ij,ijk->ik", weights, each) for each in (points, radii))
        (one, other), r = points[:, 0], radii[:, 0, 0]
        distance = float(np.linalg.norm(other - one))
        normal = (other - one) / distance
        slopes = np.array([-1, 1]) * (along @ normal) - widening[:, 0]
        return cls(distance - float(r.sum()), points[:, 0], r, normal, along, slopes)


def loaded_by(scene: Scene, pairs: Sequence[Pair]) -> Scene:
    """Return the scene with the forces of pairs as point loads."""
    loads = [load for load in scene.effects if isinstance(load, PointLoad)]
    forces = {load.s: np.array(load.force) for load in loads}
    moments = {load.s: load.moment for load in loads}
    for pair in pairs:
        for s, sign in zip(pair.s.tolist(), (-1.0, 1.0), strict=True):
            forces[s] = forces.get(s, 0.0) + sign * pair.force
    rest = (effect for effect in scene.effects if not isinstance(effect, PointLoad))
    merged = (PointLoad(s, tuple(f.tolist()), moments.get(s)) for s, f in sorted(forces.items()))
    return Scene(*rest, *merged)


# An equilibrium, and the pairs that are closed.
_State = tuple[Shape, tuple[Pair, ...]]


def settle_with_self_contact(problem: SettlingProblem) -> Shape:
    """Return the shape of an arm whose parts press on each other; tensions grow from zero.

    All equilibria on the way are accurate to the tolerance of gaps. Raises UnsettledContactError if
    no equilibrium is found, InputError for given lengths and `near`, and the errors of
    settle_on_meshes.
    """
    for name, value in (("lengths", problem.lengths), ("near", problem.near)):
        if value is not None:
            raise InputError(name, Described("given"), "None in a scene with SelfContact")
    arm = problem.arm
    alone = without_self_contact(problem.scene)
    check_loads(arm, alone)
    accuracy = min(problem.accuracy, THROUGH)

    def settle(T: Array, scene: Scene, near: Shape | None) -> Shape:
        def on_mesh(
            forward: ForwardMap, near: AnyEquilibrium | None, tolerance_factor: float
        ) -> AnyEquilibrium:
            return forward.solve(T, near, tolerance_factor)

        maps = forward_maps(arm, scene, problem.machine_code)
        is_branch = near is not None and is_coupled(arm, scene) and is_coupled(near.arm, near.scene)
        begin = near.equilibrium if near is not None and is_branch else None
        return settle_on_meshes(maps, on_mesh, accuracy, begin)

    return self_contact_shape(arm.flat(problem.tensions), alone, settle)


def self_contact_shape(tensions: Array, scene: Scene, settle: Settle) -> Shape:
    """Return the shape of an arm with self-contact, in a scene without the effect.

    Raises UnsettledContactError if no equilibrium is found, and the errors of `settle`.
    """

    def solve(before: float, factor: float, near: _State, least: bool) -> _State | None:
        there = None
        with timeout(factor), suppress(OctoplanError):
            there = _step(factor * tensions, scene, settle, near)
        if there is None and least:
            raise UnsettledContactError(before, "where it presses on itself is not found")
        if there is not None and slips(*there):
            sentence = "parts that press on each other slip past each other sideways; a little "
            raise UnsettledContactError(factor, sentence + "tension across decides to which side")
        return there

    rest = settle(0 * tensions, scene, None)
    if from_itself(rest).gap < 0:
        raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
    start: _State = rest, ()
    shape, pairs = stepped(solve, start, _STEPS)[-1][0]
    touches = [touch for pair in pairs for touch in _touches(shape, pair)]
    return replace(shape, self_contacts=tuple(sorted(touches, key=lambda touch: touch.s)))


def _touches(shape: Shape, pair: Pair) -> Iterator[ContactPoint]:
    """Yield the contact points of two cross-sections: each leans on the ball of the other."""
    gap = Gap.at(shape, pair.s)
    for k, sign in ((0, -1.0), (1, 1.0)):
        centre, radius, n = gap.points[1 - k], float(gap.radii[1 - k]), sign * gap.normal
        ball = Sphere(tuple(centre.tolist()), radius)
        place = centre + radius * n
        yield ContactPoint(ball, float(pair.s[k]), sign * pair.force, gap.size, place, n)


def _step(tensions: Array, scene: Scene, settle: Settle, state: _State) -> _State | None:
    """Return the equilibrium under tensions near another one; None if the step is too long.

    After a long step parts that were apart may overlap deeply, or have passed each other.
    """
    (before, _), (near, pairs) = state, state
    L, apart = before.arm.length, max(from_itself(before).gap, 0.0)
    s, radius = before.s[1:], float(before.arm.outer_radius(before.s[1:])[0].min())
    for _ in range(EXCHANGES):
        near, pairs = _with_closed_pairs(tensions, scene, settle, pairs, near)
        new, way = from_itself(near), near.position(s) - before.position(s)
        # A pair may begin by half the lesser radius inside of each other.
        deep, far = radius / 2, float(np.linalg.norm(way, axis=1).max())
        if new.gap < -deep or far > max(L / 10, apart / 2 + deep):
            return None
        pressed = [float(pair.force @ Gap.at(near, pair.s).normal) for pair in pairs]
        if min(pressed, default=0.0) < 0:
            pairs = tuple(pair for k, pair in enumerate(pairs) if k != np.argmin(pressed))
            continue
        at = np.sort(new.s)
        # Pairs within a diameter along the arm are one pair.
        known = not new.s or any(np.abs(pair.s - at).max() < 2 * radius for pair in pairs)
        if known or Gap.at(near, at).size >= -THROUGH * L:
            return near, pairs
        pairs = (*pairs, Pair(at, np.zeros(3)))
    return None


def _with_closed_pairs(
    tensions: Array, scene: Scene, settle: Settle, pairs: tuple[Pair, ...], near: Shape
) -> _State:
    """Return the equilibrium with pairs closed near a shape.

    Unknowns are forces, arc lengths of the nearer cross-sections, and the distances of the farther
    cross-sections from the tip, scaled. Residuals are the gap along the normal of a pair, the force
    across the normal, and the slopes of the gap; the slope by the farther arc length is
    complementary to the distance from the tip. Raises UnsettledContactError if no root is found,
    and the errors of `settle`.
    """
    if not pairs:
        return settle(tensions, scene, near), ()
    L, unit, last = near.arm.length, near.arm.bending_force, (near, pairs)

    def residual(z: Array) -> Array:
        nonlocal last
        check_time()
        rows, results = z.reshape(-1, 5), list[float]()
        s = L * np.clip(np.column_stack([rows[:, 3], 1 - rows[:, 4]]), _ALONG, 1)
        now = tuple(map(Pair, s, unit * rows[:, :3]))
        last = settle(tensions, loaded_by(scene, now), last[0]), now
        for row, pair in zip(rows, now, strict=True):
            gap = Gap.at(last[0], pair.s)
            across = row[:3] - gap.normal * (gap.normal @ row[:3])
            slope = min(row[4], -gap.slopes[1])
            results += [*(across + gap.normal * gap.size / L), gap.slopes[0], slope]
        return np.array(results)

    z = np.ravel([[*(pair.force / unit), pair.s[0] / L, 1 - pair.s[1] / L] for pair in pairs])
    options = {"xtol": 1e-11, "factor": 0.1}
    jacobian = partial(scipy.optimize.approx_fprime, f=residual, epsilon=_ALONG)
    end = scipy.optimize.root(residual, z, jac=jacobian, options=options).x
    end[4::5] *= end[4::5] > THROUGH
    if np.abs(residual(end)).max() >= THROUGH:
        raise UnsettledContactError(1.0, "there is no root")
    return last


def slips(shape: Shape, pairs: Sequence[Pair]) -> bool:
    """Return whether a pair slips off sideways, other forces held.

    The pair slips if the force, which rotates with the line that joins the midlines, grows faster
    than the arm's resistance: P > K d, with d the distance of the midlines. Sideways is normal to
    this line and to the arm. Parts that cross at an angle slide along the arm instead, so that the
    line keeps its direction.
    """
    for pair in pairs:
        gap, point = Gap.at(shape, pair.s), shape.collocated
        assert point is not None
        t, other = gap.along / np.linalg.norm(gap.along, axis=1)[:, None]
        if np.linalg.norm(np.cross(t, other)) > _CROSSING and pair.s[1] < shape.arm.length:
            continue
        across = np.cross(gap.normal, t)
        across /= np.linalg.norm(across)
        near, far = (point.mesh.node(float(s)) for s in pair.s)
        push = point.system.by_wrench(point.x, far) - point.system.by_wrench(point.x, near)
        change = -point.solve(push[:, :3] @ across)[point.system.layout.nodes[:, 4:7]]
        compliance = float(across @ (change[far] - change[near]))
        rotates = float(pair.force @ gap.normal) * compliance
        if compliance < 0 or rotates > np.linalg.norm(gap.points[1] - gap.points[0]):
            return True
    return False
