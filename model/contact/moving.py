"""Equilibria with contact at places that move along the arm until they are where it touches.

With all places held shut the equations are solved by Newton's method; then places move, points to
where the gap is least, ends of parts that lie to where the gap's second derivative vanishes, and
nodes move with them. Places where the obstacle would have to pull are given up, and those where the
arm would pass through it between the places become new ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.contact.along import along
from model.contact.newton import Held, newton
from model.contact.places import SAME, Place, Placed, placed
from model.contact.touches import Touches, forces, second
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Index, Linearised
from model.loads import contacts
from model.mesh import Mesh
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.scene import Scene
from model.transcription.system import System

# How often places move, or come and go.
_ROUNDS = 40
# How far off points, and ends of parts that lie, may be, over the arm's length.
_FOUND, _FOUND_END = 1e-8, 1e-10
# What a gap may be below 0, over the arm's length.
THROUGH = 1e-9
# Gaps are looked at this often in each element.
_LOOKS = 6
# Of an element: the farthest that its nodes may have moved for its states to be kept, and how far
# from an end derivatives are taken.
_KEPT, _ASIDE = 0.2, 0.05


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked for on a mesh that may move.

    Attributes
    ----------
    arm, scene
    base : Mesh
        That nodes are moved from.
    fixed : (n,)
        Arc lengths of nodes that stay [m].
    tensions : (n_tendons,)
    stages : int
    machine_code : bool
    """

    arm: Arm
    scene: Scene
    base: Mesh
    fixed: Array
    tensions: Array
    stages: int
    machine_code: bool = False

    def system(self, mesh: Mesh, pressed: bool = False) -> System:
        """Return the equations on a mesh."""
        return System(self.arm, self.scene, mesh, self.stages, True, self.machine_code, pressed)


@dataclass(frozen=True, eq=False)
class Settled:
    """An equilibrium with contact, and the places where it touches."""

    held: Held
    places: tuple[Place, ...]


def places_of(held: Held) -> tuple[Place, ...]:
    """Return places to begin with: of nodes next to each other that touch, their middle.

    Of three or more a part that lies; single nodes beyond a free one belong to it.
    """
    system, states = held.here.system, held.states
    s, force, found = system.mesh.s, forces(system, states), list[Place]()
    for j in range(force.shape[1]):
        own = np.flatnonzero(held.touches.point[:, j])
        runs = np.split(own, np.flatnonzero(np.diff(own) > 2) + 1) if own.size else []
        for run in runs if max((r.size for r in runs), default=0) > 2 else _next_to(own):
            if run.size > 2:
                found.append(Place(j, float(s[run[0]]), float(s[run[-1]])))
            else:
                weight = np.maximum(force[run, j], 1e-300)
                at = s[-1] if run[-1] == s.size - 1 else weight @ s[run] / weight.sum()
                found.append(Place(j, float(at), float(at)))
    return tuple(found)


def _next_to(own: Index) -> list[Index]:
    """Return runs of numbers that follow each other."""
    return np.split(own, np.flatnonzero(np.diff(own) > 1) + 1) if own.size else []


def settled(of: Question, held: Held, places: tuple[Place, ...]) -> Settled | None:
    """Return the equilibrium near one of which places are known about; None if none is found."""
    for _ in range(_ROUNDS):
        found = _solved(of, held, places)
        if found is None:
            return None
        held, own = found
        moved = tuple(_joined(list(_moved(of, held, places, own)), held.here.system.mesh))
        if moved == places:
            changed = _changed(of, held, places, own)
            if changed == places:
                return Settled(held, places)
            moved = changed
        places = moved
    return None


def _solved(
    of: Question, held: Held, places: tuple[Place, ...]
) -> tuple[Held, tuple[tuple[int, ...], ...]] | None:
    """Return the equilibrium with places held shut, and their nodes."""
    K = len(contacts(of.scene))
    at = placed(of.base, of.fixed, places, K)
    if at is None:
        return None
    before = held.here
    system = of.system(at.mesh, at.touches.pressed)
    touches = replace(at.touches, curve=_curves(before, places, at))
    if _near(before.system.mesh, at.mesh):
        states = before.states.copy()
    else:
        known = Known(before.system, before.states)
        states = Collocation.on(system).carried(of.tensions, known)
        states[system.of.touches[:, :, 0]] = _carried(held, system, touches)
    own = system.of.touches
    states[own[:, :, 1]] *= touches.inside | touches.end
    states[own[:, :, 0]] *= touches.held
    found = newton(system, of.tensions, 1.0, states, touches, cuts=4, fixed=True)
    return None if found is None else (found, at.nodes)


def _near(old: Mesh, new: Mesh) -> bool:
    """Return whether nodes of two meshes are where they were, but for a little."""
    if old.s.size != new.s.size:
        return False
    h = np.minimum(np.diff(old.s), np.diff(new.s)).min()
    return bool(np.abs(old.s - new.s).max() < _KEPT * h)


def _carried(held: Held, system: System, touches: Touches) -> Array:
    """Return forces (N + 1, K) to begin with on another mesh: of each obstacle those nearest."""
    old, s, found = (
        forces(held.here.system, held.states),
        system.mesh.s,
        np.zeros(touches.held.shape),
    )
    for k, j in zip(*np.nonzero(old), strict=True):
        there = np.flatnonzero(touches.held[:, j])
        if there.size:
            near = there[np.argmin(np.abs(s[there] - held.here.system.mesh.s[k]))]
            found[near, j] += old[k, j]
    return found


def _curves(before: Linearised, places: tuple[Place, ...], at: Placed) -> Array:
    """Return gap'' where points may move (N + 1, K), nan elsewhere."""
    system, found = before.system, np.full(at.touches.point.shape, np.nan)
    free = [i for i, p in enumerate(places) if not p.lies and p.start < system.arm.length]
    if free:
        s = np.array([places[i].start for i in free])
        j = np.array([places[i].obstacle for i in free])
        curve = along(system, before.x, s, j)[:, 2]
        found[[at.nodes[i][0] for i in free], j] = np.where(np.abs(curve) > 1e-3, curve, 1e-3)
    return found


def _moved(
    of: Question, held: Held, places: tuple[Place, ...], nodes: tuple[tuple[int, ...], ...]
) -> tuple[Place, ...]:
    """Return the places where the equilibrium says that they are; the same where they are found."""
    L, found = of.arm.length, list[Place]()
    shifts = second(held.here.system, held.states)
    for place, own in zip(places, nodes, strict=True):
        if place.lies:
            ends = _ends(held, place, own)
            found.append(place if ends == place.ends else Place(place.obstacle, *ends))
            continue
        shift = float(shifts[own[0], place.obstacle]) if place.start < L else 0.0
        if abs(shift) > _FOUND * L:
            most = 0.5 * float(np.diff(held.here.system.mesh.s)[max(own[0] - 1, 0)])
            s = min(place.start + float(np.clip(shift, -most, most)), L)
            place = Place(place.obstacle, s, s)
        found.append(place)
    return tuple(found)


def _ends(held: Held, place: Place, nodes: tuple[int, ...]) -> tuple[float, float]:
    """Return where a part that lies begins and ends: where gap'' of the free arm vanishes."""
    system = held.here.system
    s, L, found = system.mesh.s, system.mesh.s[-1], list[float]()
    for at, node, side in zip(place.ends, nodes, (-1, 1), strict=True):
        beyond = node + side
        if at >= L * (1 - SAME) or not 0 <= beyond < s.size:
            found.append(at)
            continue
        h = abs(s[beyond] - s[node])
        # What is known at a node is on its base side.
        look = side * _ASIDE * h * (np.arange(5) + (side > 0))
        curve = along(system, held.here.x, at + look, np.full(5, place.obstacle))[:, 2]
        here, slope = np.polynomial.polynomial.polyfit(look / h, curve, 4)[:2] / [1.0, h]
        shift = -here / slope if slope else 0.0
        most = 0.3 * min(h, place.end - place.start)
        found.append(at + float(np.clip(shift, -most, most)) * (abs(shift) > _FOUND_END * L))
    return found[0], min(found[1], float(L))


def _changed(
    of: Question, held: Held, places: tuple[Place, ...], nodes: tuple[tuple[int, ...], ...]
) -> tuple[Place, ...]:
    """Return the places after some of them came, went, parted or joined; the same if none did."""
    kept = list[Place]()
    for place, own in zip(places, nodes, strict=True):
        kept += _lying(held, place, own) if place.lies else _touching(of, held, place, own)
    kept = _joined(kept, held.here.system.mesh)
    if tuple(kept) != places:
        return tuple(kept)
    found = passing(held, places)
    return (*places, *found)


def _joined(places: list[Place], mesh: Mesh) -> list[Place]:
    """Return places where points next to a part that lies on the same obstacle belong to it."""
    found = list[Place]()
    for place in sorted(places, key=lambda own: (own.obstacle, own.start)):
        last = found[-1] if found else None
        if last is not None and last.obstacle == place.obstacle and (last.lies or place.lies):
            k = mesh.node(last.end)
            if place.start - last.end <= 1.5 * (mesh.s[min(k + 1, mesh.steps)] - mesh.s[k]):
                found[-1] = Place(place.obstacle, last.start, place.end)
                continue
        found.append(place)
    return found


def _touching(of: Question, held: Held, place: Place, nodes: tuple[int, ...]) -> list[Place]:
    """Return what becomes of a point."""
    system, j = held.here.system, place.obstacle
    if forces(system, held.states)[nodes[0], j] < 0:
        return []
    _, slope, curve = along(system, held.here.x, np.array([place.start]), np.array([j]))[0]
    h = float(np.diff(system.mesh.s)[nodes[0] - 1])
    if place.start >= of.arm.length:
        if slope <= 1e-9:
            return [place]
        s = of.arm.length - 0.3 * h
        return [Place(j, s, s)]
    if curve >= 0:
        return [place]
    return [Place(j, place.start - h / 2, min(place.start + h / 2, of.arm.length))]


def _lying(held: Held, place: Place, nodes: tuple[int, ...]) -> list[Place]:
    """Return what becomes of a part that lies."""
    system, j = held.here.system, place.obstacle
    first, last = nodes
    ends = forces(system, held.states)[[first, last], j]
    p = second(system, held.states)[first : last + 1, j]
    if ends.min() >= 0 and p.min() >= -1e-9 * max(np.abs(p).max(), 1e-30):
        return [place]
    points = [Place(j, s, s) for s in place.ends]
    if ends.min() >= 0 or ends.max() < 0:
        return points
    return [points[int(np.argmax(ends))]]


def passing(held: Held, places: tuple[Place, ...], through: float = THROUGH) -> list[Place]:
    """Return points where the arm passes through an obstacle: where gaps are least, below 0."""
    system = held.here.system
    s, gap = gaps_along(system, held.states)
    found = list[Place]()
    for j in range(gap.shape[1]):
        own = gap[:, j].copy()
        for place in places:
            if place.obstacle == j and place.lies:
                own[(s >= place.start) & (s <= place.end)] = 0.0
        low = own < -through * system.arm.length
        least = low & (own <= np.append(own[1:], np.inf)) & (own <= np.append(np.inf, own[:-1]))
        found += [Place(j, float(at), float(at)) for at in s[least]]
    return found


def gaps_along(system: System, states: Array) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m]."""
    line = Centreline.at_states(system, states)
    h = np.diff(system.mesh.s)
    share = np.tile(np.arange(1, _LOOKS + 1) / _LOOKS, h.size)
    element = np.repeat(np.arange(h.size), _LOOKS)
    s = system.mesh.s[element] + share * h[element]
    s[_LOOKS - 1 :: _LOOKS] = system.mesh.s[1:]
    points = line.moved(element, np.zeros(s.size), share)[0]
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    radius = line.radius(element, share)
    return s, distances(bodies, points)[0] - radius[:, None]
