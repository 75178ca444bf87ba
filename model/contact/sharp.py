"""Equilibria with contact at places that are refined until they are where the arm touches.

With places given the equations are solved by Newton's method. Then points move to where the gap is
least, ends of parts that lie to where the gap's second derivative is 0 beyond; of an arm that
shears to where its first is. Places where the obstacle would have to pull are given up, and where
the arm passes through it between places there are new ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.checks import SMALLEST
from model.contact.gaps import THROUGH, along, least_gaps
from model.contact.newton import STEPS, newton
from model.contact.touches import (
    Place,
    Places,
    Touches,
    forces,
    kernel_numbers,
    mesh_with,
    read_off,
    resultants,
    second,
)
from model.effects import NeoHookean, Shear
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import carried_strains
from model.loads import contacts
from model.mesh import Mesh
from model.paths import SAME, Array
from model.scene import Scene
from model.transcription.system import System
from model.transcription.touch import BEFORE
from model.winches import Winches

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
    base : System
        The equations on a mesh whose nodes may be moved to places.
    fixed : (n,)
        Arc lengths of nodes that stay [m].
    tensions : (n_tendons,)
    load : float
        Load factor.
    before : Linearised or None
        Where the arm was before, that friction acts against.
    winches : Winches or None
        What holds tendons by length.
    """

    base: System
    fixed: Array
    tensions: Array
    load: float = 1.0
    before: Linearised | None = None
    winches: Winches | None = None

    def on(self, mesh: Mesh, pressed: bool = False, scene: Scene | None = None) -> System:
        """Return the equations on another mesh, in another scene if one is given."""
        base = self.base
        form = base.of.form.stages, True, base.of.form.machine_code, pressed
        system = System(base.arm, scene or base.scene, mesh, *form)
        if self.before is not None:
            were = self.before.at(mesh.s[1:])[0][:, 4:]
            kernel_numbers(system, "contact_friction")[:, :, -BEFORE:] = were[:, None]
        return system

    def towards(self, end: Request, factor: float) -> Request:
        """Return the request so far on the way to another one, a factor of 0 to 1."""
        winches, tensions = end.winches, self.tensions + factor * (end.tensions - self.tensions)
        if winches is not None and self.winches is not None:
            slack = self.winches.lengths - winches.lengths
            winches = replace(winches, lengths=winches.lengths + (1 - factor) * slack)
        load = self.load + factor * (end.load - self.load)
        return replace(end, tensions=tensions, load=load, winches=winches)

    @property
    def corners(self) -> tuple[float, ...]:
        """Arc lengths [m] on whose base side the arm's surface ends: a point may stay there.

        That is the tip, and where a body that swells is wider before an anchorage than beyond.
        """
        arm = self.base.arm
        return (*(arm.anchorages if self.base.scene.has(NeoHookean) else ()), arm.length)


def sharpened(request: Request, near: Linearised, places: Places) -> Linearised | None:
    """Return the equilibrium near one whose places are about right; None if there is none.

    Places come and go where they are refined, or are near and move on slowly: by no less than half
    as far as in the round before.
    """
    last = np.inf
    for _ in range(STEPS):
        point = with_places(request, near, places)
        if point is None:
            return None
        after, exchanged = _refined(request, point, places), places
        # How far places move [m]; infinite where there are more or fewer.
        same = len(after) == len(places)
        off = float(np.abs(np.subtract(after, places)).max(initial=0.0)) if same else np.inf
        settled = off <= _OFF * request.base.arm.length
        if settled or last / 2 < off < _NEAR * np.diff(point.system.mesh.s).max():
            exchanged = _exchanged(request, point, places, settled)
            if settled and exchanged == places:
                return point
        same = exchanged == places
        near, places, last = (point, after, off) if same else (point, exchanged, np.inf)
    return None


def with_places(of: Request, near: Linearised, places: Places) -> Linearised | None:
    """Return the equilibrium that touches at given places, near another one."""
    mesh = mesh_with(of.base, of.fixed, places)
    if mesh is None:
        return None
    system = of.on(mesh, any(place.lies for place in places))
    touches, sheared = Touches.of(system), of.base.scene.has(Shear)
    for place in places:
        first, last, j = mesh.node(place.start), mesh.node(place.end), place.obstacle
        # Parts of an arm that shears have no forces at their ends.
        touches.held[[first, last], j] = not (place.lies and sheared)
        touches.pressing[first : last + 1, j], touches.lies[first:last, j] = place.lies, 1
    free = [p for p in places if not p.lies and p.start not in of.corners]
    if free:
        which, s = np.array([p.obstacle for p in free]), np.array([p.start for p in free])
        nodes, L = [mesh.node(p.start) for p in free], of.base.arm.length
        curve = along(near.system, near.x, s, which)[0][:, 2]
        touches.moves[nodes, which] = 1
        # Where the gap is no least one yet points move to lesser gaps.
        touches.curve[nodes, which] = np.where(curve > THROUGH**0.5 / L, curve, 1 / L)
    system = touches.on(system)
    return newton(system, of.tensions, of.load, _carried(of, near, system, touches))


def _carried(of: Request, near: Linearised, system: System, touches: Touches) -> Array:
    """Return states to begin with on another mesh: forces are those of the nodes nearest."""
    before, states = near.system, near.states
    if not np.array_equal(of.tensions, near.tensions):
        states = states + near.by_tensions @ (of.tensions - near.tensions)
    strains = carried_strains(before, before.strains(states), system)
    apart = np.abs(before.mesh.s[:, None] - system.mesh.s)
    pressed = np.zeros(touches.held.shape)
    np.add.at(pressed, apart.argmin(axis=1), resultants(before, states))
    carried = system.start(of.tensions, strains, of.load, pressed[1:])
    if system.of.form.contact_friction and before.of.form.contact_friction:
        at, now, were = apart.argmin(axis=0), system.of, before.of
        held, pressing = touches.held[:, :, None], touches.pressing[:, :, None]
        carried[now.touches] = states[were.touches[at]] * np.dstack([held, pressing])
        carried[now.friction_forces] = states[were.friction_forces[at]] * held
        carried[now.tractions] = states[were.tractions[at]] * pressing
    return carried


def _refined(of: Request, point: Linearised, places: Places) -> Places:
    """Return the places where an equilibrium says that they are."""
    refined, L = list[Place](), of.base.arm.length
    least = 0.0 if of.base.scene.has(Shear) else _SHORT * np.diff(point.system.mesh.s).max()
    for place in places:
        j, start, end = place
        if place.lies:
            first, last = (_end_shift(of, point, place, side) for side in (-1, 1))
            start, end = start + first, min(end + last, L)
        else:
            start = end = start + _point_shift(of, point, place)
        if end - start < least:
            start = end = (start + end) / 2
        refined.append(Place(j, start, end))
    return _joined(refined, point.system.mesh)


def _point_shift(of: Request, point: Linearised, place: Place) -> float:
    """Return how far on the gap is least, up to the next corner."""
    system, s, j = point.system, place.start, place.obstacle
    node, h = system.mesh.node(s), float(np.diff(system.mesh.s).max())
    shift = float(system.mesh.s[node] + second(system, point.states)[node, j]) - s
    if s in of.corners:
        _, slope, curve = along(system, point.x, np.array([s]), np.array([j]))[0][0]
        shift = -min(slope / max(curve, SMALLEST), _NEAR * h) * (slope > THROUGH)
    shift = min(max(shift, -h / 2), h / 2)
    passed = [at - s for at in of.corners if 0 < (at - s) * np.sign(shift) < abs(shift)]
    return passed[0] if passed else shift


def _end_shift(of: Request, point: Linearised, place: Place, side: int) -> float:
    """Return how far on an end of a part is.

    There gap'' of the free arm beyond is 0; with friction that inside of the part, which changes
    the stretch there and so what curvature lies on the obstacle. Of an arm that shears gap' beyond.
    """
    system, L, sheared = point.system, of.base.arm.length, of.base.scene.has(Shear)
    s, j = (place.end if side > 0 else place.start), place.obstacle
    beyond = system.mesh.node(s) + side
    if s >= L * (1 - SAME) or not 0 <= beyond < system.mesh.s.size:
        return 0.0
    h = abs(float(system.mesh.s[beyond]) - s)
    # Values at a node are those on its base side.
    within = contacts(system.scene)[j].friction > 0 and not sheared
    stations = s + np.array(
        [SAME * L * ((side > 0) != within), side * _SHORT * h, side * 2 * _SHORT * h]
    )
    gaps = along(system, point.x, stations, np.full(3, j))[0]
    # A part is too long where the free arm leaves with gap'' > 0, as if it were pulled there.
    leaves = side * gaps[:, 1] if sheared else gaps[:, 2]
    rate = float(leaves[2] - leaves[1]) / (side * _SHORT * h)
    f = float(leaves[0]) - rate * (stations[0] - s)
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    return -side * float(np.sign(f)) * min(abs(f / rate) if rate else h, most)


def _exchanged(of: Request, point: Linearised, places: Places, settled: bool) -> Places:
    """Return the places after some came or went; the same if none did."""
    system, states, touches = point.system, point.states, Touches.of(point.system)
    force, pressed = forces(system, states), resultants(system, states)
    least = np.where(touches.held, np.minimum(force, pressed), pressed)
    presses = touches.touching & (least >= -THROUGH * pressed.max(initial=0.0))
    kept = list[Place]()
    for place in read_off(system, presses, touches.lies > 0, pressed):
        stays = settled and not place.lies and place in places
        kept.append(_touching(of, point, place) if stays else place)
    new = [Place(j, s, s) for j, s in least_gaps(system, point.x, places)]
    return _joined(kept + new * (tuple(kept) == places), system.mesh)


def _touching(of: Request, point: Linearised, place: Place) -> Place:
    """Return what becomes of a point: a part, where the arm bends into the obstacle about it.

    A force at a point bends an arm that shears by an angle there.
    """
    system, s, j, L = point.system, place.start, place.obstacle, of.base.arm.length
    h = _NEAR * float(np.diff(system.mesh.s)[system.mesh.node(s) - 1])
    both = np.array([s, min(s + SAME * L, L)])
    (_, slope, curve), (_, after, _) = along(system, point.x, both, np.array([j, j]))[0]
    bends = curve < 0 and s not in of.corners
    if of.base.scene.has(Shear):
        bends = slope - after > THROUGH
    return Place(j, s - h, min(s + h, L)) if bends else place


def _joined(places: list[Place], mesh: Mesh) -> Places:
    """Return places in order, points next to a part that lies on the same obstacle within it."""
    joined = list[Place]()
    for place in sorted(places):
        last = joined[-1] if joined else place
        k = mesh.node(last.end)
        near = (mesh.s[min(k + 1, mesh.steps)] - mesh.s[k]) / 10
        same = joined and last.obstacle == place.obstacle and (last.lies or place.lies)
        if same and place.start - last.end <= near:
            joined[-1] = Place(place.obstacle, last.start, max(place.end, last.end))
        else:
            joined.append(place)
    return tuple(joined)
