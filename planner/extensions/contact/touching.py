"""Guesses for holds: arms that have just touched the held object where a force may balance it.

One contact force, with friction in its cone, balances a part of the wrench. The part that is left
depends on the point and the normal alone, so that thousands of drawn arms are ranked before one of
them is settled. Each of these is clear of the object on its way from rest, in front of the object
or beside it, and then moves to the object by the smallest change of its tensions.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium, Index
from octoplan.model.extensions.contact.effects import contacts, without_contacts
from octoplan.model.extensions.contact.gaps import gaps_along
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array, Mask
from octoplan.model.support.checks import SMALLEST
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.contact.grasp import LEVER
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.load_path import LoadPath
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solve.guesses import BendCoordinates, many_places
from octoplan.planner.solve.multistart import Multistart
from octoplan.planner.targets.backbone import Backbone

# Number of arms that are drawn; number of the nearest of these, and of the best of these, around
# which as many arms are drawn again; spread of the logarithms of their bends.
_DRAWN, _AROUND, _SPREAD = 3000, 75, 0.3
# Number of arms whose way from rest is followed: those whose force would leave least of the wrench.
_FOLLOWED = 500
# Numbers of rounds and of equal shares in each, between which the share of the tensions is found at
# which an arm first touches.
_ROUNDS, _SHARES = 2, 8
# Largest gap of a guess before it touches, and of an arm around which others are drawn, over the
# arm's length.
_NEAR, _WIDE = 0.1, 0.2
# Depth to which the tensions of a guess move the free arm into the object, over the arm's length;
# largest number of linearised steps to this depth.
_DEPTH, _APPROACHES = 2e-3, 6
# Number of passes in which the change of tensions towards an object adapts to the limits.
_PASSES = 5
# Distance of places and difference of arc lengths, over the arm's length, below which a guess comes
# after all guesses at other places.
_APART = 0.03


def balance_left(arm: Arm, hold: Hold, points: Array, normals: Array) -> Array:
    """Return the share of the wrench (n,) that one force at each point (n, 3) leaves at best.

    A tangential force beyond the cone of friction is moved to the cone in its own direction.
    """
    wrench = hold.scaled(arm) / hold.size(arm)
    levers = (points - hold.obstacle.parameters[:3]) / (LEVER * arm.length)
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    forces = np.stack([-normals, first, np.cross(normals, first)], axis=1)
    columns = np.concatenate([forces, np.cross(levers[:, None], forces)], axis=2)
    columns = columns[:, :, : wrench.size]
    pressed, *across = np.moveaxis(-np.linalg.pinv(columns.transpose(0, 2, 1)) @ wrench, 1, 0)
    tangential = np.stack(across, axis=1)
    size = np.linalg.norm(tangential, axis=1)
    within = (pressed > 0) & (size <= hold.friction * pressed)
    share = np.where(within, size / np.where(within, pressed, 1.0), hold.friction)
    direction = tangential / np.maximum(size, 1e-300)[:, None]
    edge = columns[:, 0] + np.einsum("n,nk,nkm->nm", share, direction, columns[:, 1:])
    along = -edge @ wrench / (edge**2).sum(axis=1)
    return np.asarray(np.linalg.norm(wrench + np.maximum(along, 0.0)[:, None] * edge, axis=1))


@dataclass(frozen=True, eq=False)
class _Arms:
    """Arms without loads, and the place of the smallest gap of each.

    Attributes
    ----------
    tensions : (n, n_tendons)
    places : (n, 3)
        Positions on the midlines [m].
    s, gaps : (n,)
        Arc lengths and gaps [m].
    hits : (n,)
        Whether an arm goes through another obstacle.
    """

    tensions: Array
    places: Array
    s: Array
    gaps: Array
    hits: Mask


def _arms_at(problem: PlanningProblem, body: Convex, tensions: Array) -> _Arms:
    """Return the arms without loads under tensions (n, n_tendons)."""
    others = [each.obstacle for each in contacts(problem.scene) if each.obstacle != body]
    places, s = many_places(problem, tensions)
    radii = problem.arm.outer_radius(s)[0]

    def gaps_from(obstacle: Convex) -> Array:
        gaps = obstacle.distance(places.reshape(-1, 3)).reshape(places.shape[:2]) - radii
        return np.where(np.isnan(gaps), np.inf, gaps)

    gaps = gaps_from(body)
    through = [gaps_from(other).min(axis=1) < 0 for other in others]
    each, k = np.arange(len(gaps)), gaps.argmin(axis=1)
    hits = np.any([*through, np.zeros(len(gaps), dtype=bool)], axis=0)
    return _Arms(tensions, places[each, k], s[k], gaps[each, k], hits)


def _before_first_touch(problem: PlanningProblem, body: Convex, tensions: Array) -> _Arms:
    """Return the arms at the largest shares of tensions (n, n_tendons) before they touch."""
    n = len(tensions)
    low, width = np.zeros(n), 1.0
    for _ in range(_ROUNDS):
        width /= _SHARES
        shares = np.minimum(low[:, None] + width * np.arange(1, _SHARES + 1), 1.0)
        each = (shares[:, :, None] * tensions[:, None]).reshape(-1, tensions.shape[1])
        touches = _arms_at(problem, body, each).gaps.reshape(n, _SHARES) < 0
        first = np.where(touches.any(axis=1), touches.argmax(axis=1), _SHARES)
        low = np.minimum(low + first * width, 1.0)
    return _arms_at(problem, body, low[:, None] * tensions)


def arms_that_touch(program: TensionProgram, hold: Hold) -> Iterator[tuple[LoadPath, Equilibrium]]:
    """Yield load paths of arms that have just touched the held object, and their equilibria.

    An arm that the loads press on something at rest settles with all of its tensions instead.
    """
    for tensions in _arms_beside(program.problem, hold):
        check_time()
        with suppress(OctoplanError):
            found = _touching(program, tensions)
            if found is not None:
                yield found


def _arms_beside(problem: PlanningProblem, hold: Hold) -> Iterator[Array]:
    """Yield tensions of free arms next to the held object.

    The starts are arms without loads. For each, a plan finds the tensions that bring the nearest
    place there under loads. Arms that are clear of other obstacles come first; then arms whose
    force at this place would leave least of the wrench, by increasing effort. Few drawn arms come
    near a small object; as many again are drawn around the nearest arms.
    """
    arm, body, rng = problem.arm, hold.obstacle, np.random.default_rng(0)
    tendons = frozenset(j for j in range(arm.n_tendons) if problem.allowed.upper[j] > 0)
    bends = BendCoordinates(arm, tendons, problem.allowed)
    points = bends.draw(_DRAWN)
    first = _arms_at(problem, body, bends.tensions(points))
    # The nearest arms, and the nearest of those whose force would balance most of the wrench.
    left = np.where(first.gaps < _WIDE * arm.length, _left(arm, hold, first), np.inf)
    ranks = np.argsort(first.gaps, kind="stable"), np.lexsort((first.gaps, left.round(1)))
    best = np.concatenate([rank[:_AROUND] for rank in ranks])
    around = np.repeat(points[best], _DRAWN // best.size, axis=0)
    points = np.vstack([points, around * np.exp(_SPREAD * rng.normal(size=around.shape))])
    arms = _arms_at(problem, body, bends.tensions(points))
    near = np.flatnonzero(arms.gaps < _NEAR * arm.length)
    near = near[_order(arm, hold, arms, near)][:_FOLLOWED]
    if not near.size:
        return
    arms = _before_first_touch(problem, body, arms.tensions[near])
    options, scene = problem.options.replace(margin=0.0), without_contacts(problem.scene)
    bears_loads = is_coupled(arm, scene)
    clear = np.flatnonzero((arms.gaps >= 0) & (arms.gaps < _NEAR * arm.length))
    for i in _with_new_places_first(arm, arms, clear[_order(arm, hold, arms, clear)]):
        if not bears_loads:
            yield arms.tensions[i]
            continue
        there = Backbone((tuple(arms.places[i].tolist()),), (float(arms.s[i]),))
        free = replace(problem, targets=(there,), scene=scene, options=options)
        loaded = Multistart(free, "closest").solve_from(arms.tensions[i])
        yield arms.tensions[i] if loaded is None else loaded.tensions


def _left(arm: Arm, hold: Hold, arms: _Arms) -> Array:
    """Return the share of the wrench (n,) that forces at the nearest places leave."""
    normals = hold.obstacle.gradient(arms.places)
    surface = arms.places - hold.obstacle.distance(arms.places)[:, None] * normals
    left = balance_left(arm, hold, np.nan_to_num(surface), np.nan_to_num(normals, nan=1.0))
    return np.where(np.isfinite(arms.gaps), left, np.inf)


def _order(arm: Arm, hold: Hold, arms: _Arms, which: Index) -> Index:
    """Return the order of arms: clear of other obstacles, wrench that is left, effort."""
    left = _left(arm, hold, arms).round(1)[which]
    effort = np.linalg.norm(arms.tensions[which], axis=1)
    return np.lexsort((effort, left, arms.hits[which]))


def _with_new_places_first(arm: Arm, arms: _Arms, order: Index) -> list[int]:
    """Return the order with arms that touch near the place of an earlier arm at the end."""
    coordinates = np.column_stack([arms.places, arms.s]) / (_APART * arm.length)
    news, others = list[int](), list[int]()
    for i in order.tolist():
        near = np.linalg.norm(coordinates[news] - coordinates[i], axis=1) < 1 if news else [False]
        (others if np.any(near) else news).append(i)
    return news + others


def _touching(program: TensionProgram, tensions: Array) -> tuple[LoadPath, Equilibrium] | None:
    """Return the load path and the equilibrium of an arm that has just touched the held object.

    From the given tensions (n_tendons,), of an arm that touches nothing, the arm moves to the
    object. An arm that presses lightly settles in a small part of the time of an arm that presses
    as hard as the tensions make it. None if there is no such equilibrium.
    """
    allowed, depth = program.problem.allowed, _DEPTH * program.problem.arm.length
    begin, end = np.zeros(tensions.size), tensions
    path: LoadPath = ()
    free: Equilibrium | None = None
    for _ in range(_APPROACHES):
        (there,) = program.map.many(end[None], [] if free is None else [free])
        if not isinstance(there, Equilibrium):
            return None
        gap, slope = _gap_slope(program, there)
        if gap < 0:
            break
        free, begin, path = there, end, (*path, tuple(end.tolist()))
        change = _towards(program, end, slope, gap + depth)
        end = np.clip(end + change, allowed.lower, allowed.upper)
    else:
        return None
    touched = _first_touch(program, begin, end, free)
    if touched is None:
        return None if path else ((tuple(end.tolist()),), program.settled(end))
    point = program.map.beside(touched, touched.tensions)
    if point is None:
        return None
    # A point without force counts as free. Therefore the arm presses a little.
    _, slope = _gap_slope(program, touched)
    change = _towards(program, point.tensions, slope, depth)
    point = program.map.beside(point, point.tensions + change) or point
    return (*path, tuple(point.tensions.tolist())), point


def _gap_slope(program: TensionProgram, free: Equilibrium) -> tuple[float, Array]:
    """Return the smallest gap from the held objects [m], and its derivatives (n_tendons,)."""
    s, gaps = gaps_along(free.system, free.states)
    held = _held(program)
    k, i = np.unravel_index(gaps[:, held].argmin(), (len(s), len(held)))
    body = program.holds[i].obstacle
    node = int(np.abs(free.mesh.s - s[k]).argmin())
    normal = body.gradient(free.poses[node, 4:][None])[0]
    places = free.system.layout.nodes[node, 4:7]
    return float(gaps[k, held[i]]), np.asarray(normal @ free.by_tensions[places])


def _held(program: TensionProgram) -> list[int]:
    """Return the numbers of the held objects among the contacts of the scene."""
    bodies = [contact.obstacle for contact in contacts(program.problem.scene)]
    return [bodies.index(hold.obstacle) for hold in program.holds]


def _towards(program: TensionProgram, tensions: Array, slope: Array, wanted: float) -> Array:
    """Return the smallest change of tensions within the limits that lowers a gap by a distance.

    As far as possible, by the linearised equations.
    """
    allowed = program.problem.allowed
    lower, upper = np.array(allowed.lower), np.array(allowed.upper)
    size = wanted / max(float(slope @ slope), SMALLEST)
    change = np.zeros_like(tensions)
    for _ in range(_PASSES):
        change = np.clip(tensions - size * slope, lower, upper) - tensions
        lowered = -float(slope @ change)
        if lowered <= 0 or lowered >= 0.99 * wanted:
            break
        size *= min(wanted / lowered, 10.0)
    return change


def _first_touch(
    program: TensionProgram, begin: Array, end: Array, near: Equilibrium | None
) -> Equilibrium | None:
    """Return the free arm that has just penetrated a held object on a line of tensions.

    None if the arm penetrates another obstacle first, or at the begin, or no obstacle at all.
    `near` is the free arm at the begin, None for an arm at rest.
    """
    low, high, held = 0.0, 1.0, _held(program)
    found: Equilibrium | None = None
    for _ in range(_ROUNDS):
        shares = np.linspace(low, high, _SHARES + 1)[1:]
        starts = [] if near is None else [near] * len(shares)
        arms = program.map.many(begin + shares[:, None] * (end - begin), starts)
        found = None
        for share, each in zip(shares, arms, strict=True):
            if not isinstance(each, Equilibrium):
                return None
            _, gaps = gaps_along(each.system, each.states)
            if gaps.min() < 0:
                if int(gaps.min(axis=0).argmin()) not in held:
                    return None
                found, high = each, float(share)
                break
            low = float(share)
        if found is None:
            return None
    return found if low > 0 or near is not None else None
