"""Equilibria with contact at places that are refined until they are where the arm touches.

With places given the equations are solved by Newton's method. Then points move to where the gap is
least, ends of parts that lie to where the gap's second derivative is 0 beyond; of an arm that
shears to where its first is. Places where the obstacle would have to pull are given up, and where
the arm passes through it between places there are new ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.contact.friction import set_history
from model.contact.gaps import along, least_gaps
from model.contact.newton import newton
from model.contact.touches import (
    Place,
    Places,
    Touches,
    forces,
    mesh_with,
    point_at,
    read_off,
    resultants,
    second,
    touches_at,
)
from model.effects import NeoHookean, Shear
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import Collocation
from model.loads import contacts
from model.mesh import Mesh
from model.paths import SAME, Array
from model.transcription.system import System
from model.winches import Winches

# How often places move, come or go.
_ROUNDS = 30
# How far off places may be, over the arm's length.
_OFF = 1e-10
# gap'' [1/m] that counts as flat, and what points move by instead, over 1 / L: to lesser gaps.
_FLAT, _BENT = 1e-3, 4.0
# Over an element: how far from an end derivatives are taken, half the length of a part that was a
# point and how far points move from corners at most, parts that are points, and what is near.
_ASIDE, _BORN, _SHORT, _NEAR = 0.05, 0.3, 0.02, 0.25
# Of the largest force, what is rounding.
_ROUNDING = 1e-9


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

    def on(self, mesh: Mesh, pressed: bool = False) -> System:
        """Return the equations on another mesh."""
        base = self.base
        form = base.of.form.stages, True, base.of.form.machine_code, pressed
        system = System(base.arm, base.scene, mesh, *form)
        if self.before is not None and system.of.form.contact_friction:
            set_history(system, self.before)
        return system

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
    for _ in range(_ROUNDS):
        point = with_places(request, near, places)
        if point is None:
            return None
        after = _refined(request, point, places)
        off = _apart(places, after)
        if off == 0 or last / 2 < off < _NEAR * np.diff(point.system.mesh.s).max():
            exchanged = _exchanged(request, point, places, off == 0)
            if off == 0 and exchanged == places:
                return point
            after, off = (after, off) if exchanged == places else (exchanged, np.inf)
        near, places, last = point, after, off
    return None


def _apart(places: Places, others: Places) -> float:
    """Return how far places are from others [m]; infinite where there are more or fewer."""
    if len(places) != len(others):
        return np.inf
    ends = (np.array([[at.start, at.end] for at in each]) for each in (places, others))
    return float(np.abs(np.subtract(*ends)).max(initial=0.0))


def with_places(of: Request, near: Linearised, places: Places) -> Linearised | None:
    """Return the equilibrium that touches at given places, near another one."""
    scene, mesh = of.base.scene, mesh_with(of.base, of.fixed, places)
    if mesh is None:
        return None
    system = of.on(mesh, any(place.lies for place in places))
    touches = touches_at(system, places, scene.has(Shear))
    free = [p for p in places if not p.lies and p.start not in of.corners]
    if free:
        s, j = np.array([p.start for p in free]), np.array([p.obstacle for p in free])
        curve, nodes = along(near.system, near.x, s, j)[:, 2], [mesh.node(p.start) for p in free]
        touches.moves[nodes, j] = 1
        touches.curve[nodes, j] = np.where(curve > _FLAT, curve, _BENT / of.base.arm.length)
    system = touches.on(system)
    return newton(system, of.tensions, of.load, _carried(of, near, system))


def _carried(of: Request, near: Linearised, system: System) -> Array:
    """Return states to begin with on another mesh: forces are those of the nodes nearest."""
    before, states = near.system, Collocation.on(system).carried(of.tensions, near).copy()
    old, new, touches = before.of, system.of, Touches.of(system)
    at = np.abs(system.mesh.s[:, None] - before.mesh.s).argmin(axis=1)
    pressed = (second(before, near.states) * Touches.of(before).pressing)[at]
    states[new.touches[:, :, 0]] = forces(before, near.states)[at] * touches.held
    states[new.touches[:, :, 1]] = pressed * touches.pressing
    if new.form.contact_friction and old.form.contact_friction:
        for kind, mask in (("friction_forces", touches.held), ("tractions", touches.pressing)):
            rubbed = near.states[getattr(old, kind)[at]]
            states[getattr(new, kind)] = rubbed * mask[:, :, None]
    return states


def _refined(of: Request, point: Linearised, places: Places) -> Places:
    """Return the places where an equilibrium says that they are; the same where they are right."""
    refined, L = list[Place](), of.base.arm.length
    least = 0.0 if of.base.scene.has(Shear) else _SHORT * np.diff(point.system.mesh.s).max()
    for place in places:
        if not place.lies:
            start = end = place.start + _point_shift(of, point, place)
        else:
            start = place.start + _end_shift(of, point, place, -1)
            end = min(place.end + _end_shift(of, point, place, 1), L)
            if end - start < least:
                start = end = (start + end) / 2
        refined.append(Place(place.obstacle, start, end))
    return _joined(refined, point.system.mesh)


def _point_shift(of: Request, point: Linearised, place: Place) -> float:
    """Return how far on the gap is least, up to the next corner; 0 where that is close."""
    system, s, j = point.system, place.start, place.obstacle
    node, h = system.mesh.node(s), float(np.diff(system.mesh.s).max())
    if s in of.corners:
        _, slope, curve = along(system, point.x, np.array([s]), np.array([j]))[0]
        shift = -min(slope / max(curve, _FLAT), _BORN * h) * (slope > _ROUNDING)
    else:
        shift = float(system.mesh.s[node] + second(system, point.states)[node, j]) - s
    shift = min(max(shift, -h / 2), h / 2)
    passed = [at - s for at in of.corners if 0 < (at - s) * np.sign(shift) < abs(shift)]
    shift = passed[0] if passed else shift
    return shift if abs(shift) > _OFF * of.base.arm.length else 0.0


def _end_shift(of: Request, point: Linearised, place: Place, side: int) -> float:
    """Return how far on an end of a part is; 0 where that is close.

    There gap'' of the free arm beyond is 0; with friction that inside of the part, which changes
    the stretch there and so what curvature lies on the obstacle. Of an arm that shears gap' beyond.
    """
    system, L = point.system, of.base.arm.length
    s = place.end if side > 0 else place.start
    node = system.mesh.node(s)
    beyond = node + side
    if s >= L * (1 - SAME) or not 0 <= beyond < system.mesh.s.size:
        return 0.0
    h, j = abs(float(system.mesh.s[beyond]) - s), place.obstacle
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    # Values at a node are those on its base side.
    within = contacts(system.scene)[j].friction > 0 and not system.scene.has(Shear)
    at = s + SAME * L * ((side > 0) != within)
    stations = np.array([at, s + side * _ASIDE * h, s + 2 * side * _ASIDE * h])
    _, slope, curve = along(system, point.x, stations, np.full(3, j)).T
    if system.scene.has(Shear):
        f, rate = float(slope[0] - curve[0] * (at - s)), float(curve[0])
        shift = -f / rate if rate > 0 else side * h * float(np.sign(f))
    else:
        rate = float(curve[2] - curve[1]) / (side * _ASIDE * h)
        f = float(curve[0]) - rate * (at - s)
        # A part is too long where the free arm leaves with gap'' > 0, as if it were pulled there.
        shift = -side * float(np.sign(f)) * abs(f / rate if rate else h)
    return min(max(shift, -most), most) if abs(shift) > _OFF * L else 0.0


def _exchanged(of: Request, point: Linearised, places: Places, settled: bool) -> Places:
    """Return the places after some came or went; the same if none did."""
    system, states, touches = point.system, point.states, Touches.of(point.system)
    force, pressed = forces(system, states), resultants(system, states)
    least = np.where(touches.held, np.minimum(force, pressed), pressed)
    presses = touches.touching & (least >= -_rounding(system, pressed)[:, None])
    kept = list[Place]()
    for place in read_off(system, presses, touches.lies > 0, pressed):
        stays = settled and not place.lies and place in places
        kept += _touching(of, point, place) if stays else [place]
    if tuple(kept) != places:
        return _joined(kept, system.mesh)
    new = [point_at(*least) for least in least_gaps(system, point.x, places)]
    return _joined([*kept, *new], system.mesh) if new else places


def _rounding(system: System, pressed: Array) -> Array:
    """Return what forces (N + 1,) are rounding [N]: a part of the largest of those that press.

    Or what bends the elements beside a node by the last digit of its place.
    """
    arm, s = system.arm, system.mesh.s
    h = np.diff(s)
    shortest = np.minimum(np.append(h[0], h), np.append(h, h[-1]))
    EJ = arm.material.E * np.pi * arm.radius.evaluate(s, arm.length)[0] ** 4 / 4
    last = np.finfo(float).eps * arm.length * EJ / shortest**3
    return np.asarray(np.maximum(last, _ROUNDING * pressed.max(initial=0.0)))


def _touching(of: Request, point: Linearised, place: Place) -> list[Place]:
    """Return what becomes of a point: a part, where the arm bends into the obstacle about it."""
    system, s, j = point.system, place.start, place.obstacle
    L, h = of.base.arm.length, float(np.diff(system.mesh.s)[system.mesh.node(s) - 1])
    beyond = min(s + SAME * L, L)
    (_, slope, curve), (_, after, beyond_curve) = along(
        system, point.x, np.array([s, beyond]), np.array([j, j])
    )
    if system.scene.has(Shear):
        # A force at a point bends an arm that shears by an angle there.
        length = (slope - after) / max(curve, beyond_curve, _FLAT)
        return [Place(j, s, min(s + length, L)) if length > 2 * SAME * L else place]
    if curve >= 0 or s in of.corners:
        return [place]
    return [Place(j, s - _BORN * h, min(s + _BORN * h, L))]


def _joined(places: list[Place], mesh: Mesh) -> Places:
    """Return places in order, points next to a part that lies on the same obstacle within it."""
    joined = list[Place]()
    for place in sorted(places):
        last = joined[-1] if joined else None
        if last is not None and last.obstacle == place.obstacle and (last.lies or place.lies):
            k = mesh.node(last.end)
            if place.start - last.end <= (mesh.s[min(k + 1, mesh.steps)] - mesh.s[k]) / 10:
                joined[-1] = replace(last, end=max(place.end, last.end))
                continue
        joined.append(place)
    return tuple(joined)
