"""Equilibria with contact at places that are refined until they are where the arm touches.

With places given the equations are solved by Newton's method. Then points move to where the gap is
least, ends of parts that lie to where the gap's second derivative is 0 beyond; of an arm that
shears to where its first is. Places where the obstacle would have to pull are given up, and where
the arm passes through it between places there are new ones.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np

from octoplan.model.centreline import stretch_beside
from octoplan.model.effects import NeoHookean, Shear
from octoplan.model.equilibrium.collocation_map import predict_states, transfer_strains
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import (
    MAX_BRANCH_ROTATION,
    MAX_STEPS_IN_CONTACT,
    Start,
    newton,
)
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.contact.gaps import THROUGH, along, least_gaps
from octoplan.model.extensions.contact.kernels import BEFORE
from octoplan.model.extensions.contact.term import ContactTerm, contact_places
from octoplan.model.extensions.contact.touches import (
    BESIDE,
    ContactFlags,
    Place,
    Places,
    forces,
    kernel_numbers,
    mesh_with,
    places_of,
    read_off,
    resultants,
    second,
)
from octoplan.model.extensions.obstacles.base import SIZE
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.checks import SMALLEST

# How far off places may be, over the arm's length.
_OFF = THROUGH / 10
# Over an element: parts that are points, and how far from an end derivatives are taken; what is
# near: half the length of a part that was a point, how far points move from corners at most.
_SHORT, _NEAR = 0.02, 0.25


@dataclass(frozen=True, eq=False)
class Request:
    """The equilibrium that is wanted.

    Attributes
    ----------
    base : DiscreteRod
        The equations on a mesh whose nodes may be moved to places.
    fixed : (n,)
        Arc lengths of nodes that stay [m].
    tensions : (n_tendons,)
    load : float
        Load factor.
    before : Equilibrium or None
        Where the arm was before, that friction acts against.
    """

    base: DiscreteRod
    fixed: Array
    tensions: Array
    load: float = 1.0
    before: Equilibrium | None = None

    def on(self, places: Places) -> DiscreteRod | None:
        """Return the equations on a mesh with nodes at places; None where there is none."""
        base, mesh = self.base, mesh_with(self.base, self.fixed, places)
        if mesh is None:
            return None
        conforms = any(place.lies for place in places)
        terms = tuple(
            replace(term, pressed=conforms) if isinstance(term, ContactTerm) else term
            for term in base.scene.rod_terms
        )
        system = base.on_mesh(mesh, terms=terms)
        if self.before is not None:
            were = self.before.at(mesh.s[1:])[0][:, 4:]
            kernel_numbers(system, "touch")[:, :, BEFORE] = were[:, None]
        return system

    @property
    def corners(self) -> tuple[float, ...]:
        """Arc lengths [m] on whose base side the arm's surface ends: a point may stay there.

        That is the tip, and where a body that swells is wider before an anchorage than beyond.
        """
        arm = self.base.arm
        return (*(arm.anchorages if self.base.scene.has(NeoHookean) else ()), arm.length)


def close(one: Equilibrium, other: Equilibrium, most: float = MAX_BRANCH_ROTATION) -> bool:
    """Return whether frames turn by less than most [rad] between equilibria, on any two meshes."""
    before, after = one.poses[:, :4], other.poses[:, :4]
    there = np.array([np.interp(other.mesh.s, one.mesh.s, column) for column in before.T]).T
    same = np.abs((there * after).sum(axis=1)) / np.linalg.norm(there, axis=1)
    return bool(same.min() > np.cos(most / 2))


def sharpened(
    request: Request, near: Equilibrium, places: Places | None = None
) -> Equilibrium | None:
    """Return the equilibrium near one whose places are about right; None if there is none close.

    The places are those where it touches, moved as tensions change, unless others are given. Places
    come and go where they are refined, or are near and move on slowly: by no less than half as far
    as in the round before.
    """
    begin, last = near, None
    if places is None:
        x = near.system.x(request.tensions, request.load, predict_states(near, request.tensions))
        places = _correct_places(request, Equilibrium(near.system, x), places_of(near.system))
    for _ in range(MAX_STEPS_IN_CONTACT):
        point = at_places(request, near, places)
        if point is None:
            return None
        refined = _correct_places(request, point, places)
        # How far places move [m].
        shift = np.subtract(refined, places).reshape(-1, 3)[:, 1:]
        off, h = float(np.abs(shift).max(initial=0.0)), np.diff(point.system.mesh.s).max()
        near, settled = point, off <= _OFF * request.base.arm.length
        if settled or (last is not None and np.abs(last).max(initial=0.0) / 2 < off < _NEAR * h):
            exchanged = _exchange_places(request, point, places, settled)
            if exchanged != places:
                places, last = exchanged, None
                continue
            if settled:
                return point if close(begin, point) else None
        places, last = _extrapolated(refined, shift, last, _NEAR * h), shift
    return None


def _extrapolated(refined: Places, shift: Array, before: Array | None, most: float) -> Places:
    """Return refined places, by Aitken's extrapolation where they converge slowly.

    That is of the last two shifts (K, 2), by no more than `most` [m]. An arm that is straight
    beyond a point lies along a flat obstacle without a force: gap' and gap'' hardly tell where the
    point is.
    """
    if before is None:
        return refined
    ratio = np.divide(shift, before, out=np.zeros_like(shift), where=before != 0)
    rate = np.where((ratio > 0.5) & (ratio < 1), ratio, 0.0)
    more = np.clip(shift * rate / (1 - rate), -most, most).tolist()
    return tuple(
        Place(obstacle, start + at_start, end + at_end)
        for (obstacle, start, end), (at_start, at_end) in zip(refined, more, strict=True)
    )


def at_places(of: Request, near: Equilibrium, places: Places) -> Equilibrium | None:
    """Return the equilibrium that touches at given places, near another one."""
    system = of.on(places)
    if system is None:
        return None
    mesh, touches, sheared = system.mesh, ContactFlags.of(system), of.base.scene.has(Shear)
    for place in places:
        j, first, last = place.obstacle, mesh.node(place.start), mesh.node(place.end)
        # Parts of an arm that shears have no forces at their ends.
        touches.held[[first, last], j] = not (place.lies and sheared)
        touches.pressing[first : last + 1, j], touches.lies[first:last, j] = place.lies, 1
        touches.moves[first, j] = not (place.lies or place.start in of.corners)
    system = touches.on(system)
    states = _initial_states(of, near, system, touches)
    return newton(
        system, [Start(of.tensions, of.load, states)], update_contacts=_with_larger_radius
    )[0]


def _with_larger_radius(system: DiscreteRod, states: Array) -> DiscreteRod:
    """Return equations whose gaps are taken with the larger radius of both sides of each node.

    Friction at a point, and on a tapered arm what presses there, has a part along the arm: it lets
    the stretch jump, and with it the radius of a body that swells.
    """
    if not system.scene.has(NeoHookean):
        return system
    result = copy.copy(system)
    before, beyond = stretch_beside(system, states[system.layout.stages])
    # The kernel divides by the root of the stretch before a node.
    wider = system.arm.outer_radius(system.mesh.s[1:])[0] * np.sqrt(np.maximum(before / beyond, 1))
    kernel_numbers(result, "touch")[:, :, SIZE] = wider[:, None]
    return result


def _gap_at(point: Equilibrium, s: float, obstacle: int) -> tuple[float, float, float]:
    """Return gap [m], gap' [-] and gap'' [1/m] of an obstacle at an arc length [m]."""
    ((gap, slope, curve),), _ = along(point.system, point.x, np.array([s]), np.array([obstacle]))
    return float(gap), float(slope), float(curve)


def _initial_states(
    of: Request, near: Equilibrium, system: DiscreteRod, touches: ContactFlags
) -> Array:
    """Return states to begin with on another mesh: forces are those of the nodes nearest."""
    before, states = near.system, predict_states(near, of.tensions)
    strains = transfer_strains(before, states[before.layout.stages], system)
    apart = np.abs(before.mesh.s[:, None] - system.mesh.s)
    now = contact_places(system.layout)
    were = contact_places(before.layout)
    pressed = np.zeros(touches.held.shape)
    np.add.at(pressed, apart.argmin(axis=1), resultants(before, states))
    carried = system.initial_states(
        of.tensions, strains, of.load, (now.touches[1:, :, 0], pressed[1:])
    )
    if now.friction_forces.size and were.friction_forces.size:
        at, held, pressing = apart.argmin(axis=0), touches.held, touches.pressing
        carried[now.touches] = states[were.touches[at]] * np.stack([held, pressing], axis=2)
        carried[now.friction_forces] = states[were.friction_forces[at]] * held[:, :, None]
        if now.tractions.size and were.tractions.size:
            carried[now.tractions] = states[were.tractions[at]] * pressing[:, :, None]
    return carried


def _correct_places(of: Request, point: Equilibrium, places: Places) -> Places:
    """Return the places where an equilibrium says that they start and end, in order."""
    return tuple(
        sorted(Place(place.obstacle, *_correct_place(of, point, place)) for place in places)
    )


def _correct_place(of: Request, point: Equilibrium, place: Place) -> tuple[float, float]:
    """Return where an equilibrium says that a place starts and ends; a short part is a point."""
    _, start, end = place
    if not place.lies:
        start = end = start + _point_shift(of, point, place)
        return start, end
    first, last = (_end_shift(of, point, place, side) for side in (-1, 1))
    start, end = start + first, min(end + last, of.base.arm.length)
    sheared, h = of.base.scene.has(Shear), np.diff(point.system.mesh.s).max()
    if end - start < (0.0 if sheared else _SHORT * h):
        start = end = (start + end) / 2
    return start, end


def _point_shift(of: Request, point: Equilibrium, place: Place) -> float:
    """Return how far on the gap is least, up to the next corner."""
    system, s, j = point.system, place.start, place.obstacle
    node, h = system.mesh.node(s), float(np.diff(system.mesh.s).max())
    shift = float(system.mesh.s[node] + second(system, point.states)[node, j]) - s
    if s in of.corners:
        _, slope, curve = _gap_at(point, s, j)
        shift = -min(slope / max(curve, SMALLEST), _NEAR * h) * (slope > THROUGH)
    shift = min(max(shift, -h / 2), h / 2)
    passed = [at - s for at in of.corners if 0 < (at - s) * np.sign(shift) < abs(shift)]
    return passed[0] if passed else shift


def _end_shift(of: Request, point: Equilibrium, place: Place, side: int) -> float:
    """Return how far on an end of a part is.

    There gap'' of the free arm beyond is 0; with friction that inside of the part, which changes
    the stretch there and so what curvature lies on the obstacle. Of an arm that shears gap' beyond.
    """
    system, L, sheared = point.system, of.base.arm.length, of.base.scene.has(Shear)
    s, j = (place.end if side > 0 else place.start), place.obstacle
    beyond = system.mesh.node(s) + side
    if beyond > system.mesh.elements:
        return 0.0
    h = abs(float(system.mesh.s[beyond]) - s)
    # Values at a node are those on its base side.
    within = contacts(system.scene)[j].friction > 0 and not sheared
    off = np.array([SAME * L * ((side > 0) != within), side * _SHORT * h, side * 2 * _SHORT * h])
    gaps, _ = along(system, point.x, s + off, np.full(3, j))
    # A part is too long where the free arm leaves with gap'' > 0, as if it were pulled there.
    leaves = side * gaps[:, 1] if sheared else gaps[:, 2]
    rate = float(leaves[2] - leaves[1]) / (side * _SHORT * h)
    # The rate is that of the free arm: inside of the part, where gap'' is 0, it is none.
    f = float(leaves[0]) - rate * float(off[0]) * (not within)
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    return -side * float(np.sign(f)) * min(abs(f / rate) if rate else h, most)


def _exchange_places(of: Request, point: Equilibrium, places: Places, settled: bool) -> Places:
    """Return the places after some came or went; the same if none did."""
    system, states, touches = point.system, point.states, ContactFlags.of(point.system)
    force, pressed = forces(system, states), resultants(system, states)
    least = np.where(touches.held, np.minimum(force, pressed), pressed)
    presses = touches.touching & (least >= -THROUGH * pressed.max(initial=0.0))
    kept = [
        _part_about_point(of, point, place) if settled and place in places else place
        for place in read_off(system, presses, touches.lies > 0, pressed)
    ]
    new = least_gaps(system, point.x, places) if tuple(kept) == places else ()
    return tuple(sorted([*kept, *new]))


def _part_about_point(of: Request, point: Equilibrium, place: Place) -> Place:
    """Return a part in place of a point about which the arm bends into the obstacle.

    A force at a point bends an arm that shears by an angle there: a part is about as long as it
    takes the gap's curvature to make up for that, or remains a point where nodes would be one.
    """
    system, (j, s, _), L = point.system, place, of.base.arm.length
    _, slope, curve = _gap_at(point, s, j)
    half, bends = _NEAR * float(np.diff(system.mesh.s)[system.mesh.node(s) - 1]), curve < 0
    if of.base.scene.has(Shear):
        angle = slope - _gap_at(point, min(s + SAME * L, L), j)[1]
        needed = angle / 2 / max(curve, SMALLEST)
        half, bends = min(half, needed), needed > BESIDE * L
    elif s in of.corners:
        bends = False
    return Place(j, s - half, min(s + half, L)) if bends and not place.lies else place
