"""Equilibria with contact at places that move along the arm until they are where it touches.

With places given the equations are solved by Newton's method. Then points move to where the gap is
least, ends of parts that lie to where the gap's second derivative is 0 beyond; of an arm that
shears to where its first is. Places where the obstacle would have to pull are given up, and where
the arm passes through it between places there are new ones.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from model.contact.gaps import along, least_gaps
from model.contact.history import History
from model.contact.newton import newton
from model.contact.places import SAME, Place, Places, mesh_with, point, touches_at
from model.contact.touches import Touches, forces, resultants, second
from model.effects import NeoHookean, Shear
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.loads import contacts
from model.mesh import Mesh
from model.paths import Array
from model.transcription.system import System

# How often places move, come or go; how often the same ones may come again; rounding of these.
_ROUNDS, _AGAIN, _DIGITS = 30, 2, 8
# How far off points and ends may be, over the arm's length.
_POINT, _END = 1e-8, 1e-10
# gap'' [1/m] that counts as flat, and what points move by instead, over 1 / L: to lesser gaps.
_FLAT, _BENT = 1e-3, 4.0
# Over an element: how far from an end derivatives are taken, half the length of a part that was a
# point and how far points move from corners at most, and parts that are points.
_ASIDE, _BORN, _SHORT = 0.05, 0.3, 0.02
# Of the largest force, what is rounding, and what pulls so hard that places need not be found.
_ROUNDING, _PULLED = 1e-9, 1e-2


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked for.

    Attributes
    ----------
    base : System
        The equations on a mesh whose nodes may be moved to places.
    fixed : (n,)
        Arc lengths of nodes that stay [m].
    tensions : (n_tendons,)
    load : float
        Load factor.
    history : History or None
        Where the arm was before, that friction acts against.
    """

    base: System
    fixed: Array
    tensions: Array
    load: float = 1.0
    history: History | None = None

    def on(self, mesh: Mesh, pressed: bool = False) -> System:
        """Return the equations on another mesh."""
        base = self.base
        form = base.of.form.stages, True, base.of.form.machine_code, pressed
        found = System(base.arm, base.scene, mesh, *form)
        if self.history is not None and found.of.form.contact_friction:
            self.history.told(found)
        return found

    @property
    def corners(self) -> tuple[float, ...]:
        """Arc lengths [m] on whose base side the arm's surface ends: a point may stay there.

        That is the tip, and where a body that swells is wider before an anchorage than beyond.
        """
        arm = self.base.arm
        return (*(arm.anchorages if self.base.scene.has(NeoHookean) else ()), arm.length)


@dataclass(frozen=True, eq=False)
class Settled:
    """An equilibrium with contact, and the places where it touches."""

    here: Linearised
    places: Places


def sharpened(of: Question, here: Linearised, places: Places) -> Settled | None:
    """Return the equilibrium near one of which places are known about; None if none is found."""
    seen, roots, last = Counter[Places](), dict[tuple[int, int], _Root](), places
    for _ in range(_ROUNDS):
        found = with_places(of, here, places)
        if found is None:
            return None
        here, last, force = found, places, forces(found.system, found.states)
        if force.min() >= -_PULLED * force.max():
            places = _moved(of, here, places, roots)
        if places == last:
            places = _exchanged(of, here, places)
            if places == last:
                return Settled(here, places)
            roots, rounded = {}, tuple(_rounded(own, of.base.arm.length) for own in places)
            seen[rounded] += 1
            if seen[rounded] > _AGAIN:
                return None
    return None


def _rounded(own: Place, length: float) -> Place:
    start, end = (round(s / length, _DIGITS) for s in (own.start, own.end))
    return Place(own.obstacle, start, end)


def with_places(of: Question, here: Linearised, places: Places) -> Linearised | None:
    """Return the equilibrium that touches at given places, near another one."""
    scene, mesh = of.base.scene, mesh_with(of.base, of.fixed, places)
    if mesh is None:
        return None
    touches = touches_at(mesh, places, len(contacts(scene)), scene.has(Shear))
    free = [p for p in places if not p.lies and p.start not in of.corners]
    if free:
        s, j = np.array([p.start for p in free]), [p.obstacle for p in free]
        curve = along(here.system, here.x, s, np.array(j))[:, 2]
        nodes = [mesh.node(p.start) for p in free]
        flat = _BENT / of.base.arm.length
        touches.curve[nodes, j] = np.where(curve > _FLAT, curve, flat)
    system = touches.told(of.on(mesh, bool(touches.lies.any())))
    return newton(system, of.tensions, of.load, _carried(of, here, system, touches))


def _carried(of: Question, here: Linearised, system: System, touches: Touches) -> Array:
    """Return states to begin with on another mesh: forces are those of the nodes nearest."""
    before, states = here.system, Collocation.on(system).carried(of.tensions, here).copy()
    old, new, s = before.of, system.of, before.mesh.s
    there = Touches.of(before)
    near = np.abs(system.mesh.s[:, None] - s).argmin(axis=1)
    p = second(before, here.states) * there.pressing
    for j in range(p.shape[1]):
        pressing = np.interp(system.mesh.s, s, p[:, j]) * touches.pressing[:, j]
        states[new.touches[:, j, 1]], states[new.touches[:, j, 0]] = pressing, 0.0
        held = np.flatnonzero(touches.held[:, j])
        for k in np.flatnonzero(there.held[:, j]) if held.size else ():
            nearest = held[np.argmin(np.abs(system.mesh.s[held] - s[k]))]
            states[new.touches[nearest, j, 0]] += here.states[old.touches[k, j, 0]]
    if new.form.contact_friction and old.form.contact_friction:
        for kind, mask in (("friction_forces", touches.held), ("tractions", touches.pressing)):
            rubbed = here.states[getattr(old, kind)[near]]
            states[getattr(new, kind)] = rubbed * mask[:, :, None]
    return states


def _moved(
    of: Question, here: Linearised, places: Places, roots: dict[tuple[int, int], _Root]
) -> Places:
    """Return the places where an equilibrium says that they are; the same where they are found."""
    found = list[Place]()
    for i, place in enumerate(places):
        if place.lies:
            ends = [_end(of, here, place, side) for side in (-1, 1)]
        else:
            ends = [_point(of, here, place)]
        at = [place.start, place.end][: len(ends)]
        for k, (f, shift, most) in enumerate(ends):
            root = roots.setdefault((i, k), _Root())
            close = (_END if place.lies else _POINT) * of.base.arm.length
            if abs(shift) > close and not root.is_jump(at[k], f, close):
                after = root.next(at[k], f, shift, most)
                at[k] = after if place.lies else _up_to_corner(of, at[k], after)
        first, last = at[0], min(at[-1], of.base.arm.length)
        least = 0.0 if of.base.scene.has(Shear) else _SHORT * np.diff(here.system.mesh.s).max()
        if place.lies and last - first < least:
            first = last = (first + last) / 2
        found.append(Place(place.obstacle, min(first, last), last))
    return _joined(found, here.system.mesh)


def _up_to_corner(of: Question, s: float, after: float) -> float:
    """Return where a point goes that passes no corner."""
    passed = [own for own in of.corners if min(s, after) < own < max(s, after)]
    return passed[0] if passed else after


def _point(of: Question, here: Linearised, place: Place) -> tuple[float, float, float]:
    """Return gap' at a point, how far on the gap is least, and how far it may move."""
    system, s, j = here.system, place.start, place.obstacle
    node, h = system.mesh.node(s), float(np.diff(system.mesh.s).max())
    if s in of.corners:
        _, slope, curve = along(system, here.x, np.array([s]), np.array([j]))[0]
        return slope, -min(slope / max(curve, _FLAT), _BORN * h) * (slope > _ROUNDING), h
    shift = float(system.mesh.s[node] + second(system, here.states)[node, j]) - s
    return -float(Touches.of(system).curve[node, j]) * shift, shift, h / 2


def _end(of: Question, here: Linearised, place: Place, side: int) -> tuple[float, float, float]:
    """Return what is 0 at the end of a part, how far on it is, and how far the end may move.

    gap'' of the free arm beyond; with friction that inside of the part, which changes the stretch
    there and so what curvature lies on the obstacle. Of an arm that shears gap' beyond.
    """
    system, L = here.system, of.base.arm.length
    s = place.end if side > 0 else place.start
    node = system.mesh.node(s)
    beyond = node + side
    if s >= L * (1 - SAME) or not 0 <= beyond < system.mesh.s.size:
        return 0.0, 0.0, 0.0
    h, j = abs(float(system.mesh.s[beyond]) - s), place.obstacle
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    # What is known at a node is on its base side.
    within = contacts(system.scene)[j].friction > 0 and not system.scene.has(Shear)
    at = s + SAME * L * ((side > 0) != within)
    looks = np.array([at, s + side * _ASIDE * h, s + 2 * side * _ASIDE * h])
    _, slope, curve = along(system, here.x, looks, np.full(3, j)).T
    if system.scene.has(Shear):
        f, rate = float(slope[0] - curve[0] * (at - s)), float(curve[0])
        return f, -f / rate if rate > 0 else side * h * float(np.sign(f)), most
    rate = float(curve[2] - curve[1]) / (side * _ASIDE * h)
    f = float(curve[0]) - rate * (at - s)
    # A part is too long where the free arm leaves with gap'' > 0, as if it were pulled there.
    return f, -side * float(np.sign(f)) * abs(f / rate if rate else h), most


def _exchanged(of: Question, here: Linearised, places: Places) -> Places:
    """Return the places after some came or went; the same if none did."""
    system, states, touches = here.system, here.states, Touches.of(here.system)
    force, pressed = forces(system, states), resultants(system, states, touches)
    kept, least = list[Place](), -_rounding(system, pressed)
    for place in places:
        j, k = place.obstacle, [system.mesh.node(s) for s in (place.start, place.end)]
        if place.lies:
            ends, part = force[k, j], slice(k[0], k[1] + 1)
            pulled = ends < least[k]
            if pulled.any() or (pressed[part, j] < least[part]).any():
                both = [point(j, place.start), point(j, place.end)]
                kept += [both[int(np.argmax(ends))]] if pulled.any() else both
            else:
                kept.append(place)
        elif force[k[0], j] >= least[k[0]]:
            kept += _touching(of, here, place)
    if tuple(kept) != places:
        return _joined(kept, system.mesh)
    new = [point(*least) for least in least_gaps(system, here.x, places)]
    return _joined([*kept, *new], system.mesh) if new else places


def _rounding(system: System, pressed: Array) -> Array:
    """Return what forces (N + 1,) are rounding [N]: a share of the largest of those that press.

    Or what bends the elements beside a node by the last digit of its place.
    """
    arm, s = system.arm, system.mesh.s
    h = np.diff(s)
    shortest = np.minimum(np.append(h[0], h), np.append(h, h[-1]))
    EJ = arm.material.E * np.pi * arm.radius.evaluate(s, arm.length)[0] ** 4 / 4
    last = np.finfo(float).eps * arm.length * EJ / shortest**3
    return np.asarray(np.maximum(last, _ROUNDING * pressed.max(initial=0.0)))


def _touching(of: Question, here: Linearised, place: Place) -> list[Place]:
    """Return what becomes of a point: a part, where the arm bends into the obstacle about it."""
    system, s, j = here.system, place.start, place.obstacle
    L, h = of.base.arm.length, float(np.diff(system.mesh.s)[system.mesh.node(s) - 1])
    beyond = min(s + SAME * L, L)
    (_, slope, curve), (_, after, beyond_curve) = along(
        system, here.x, np.array([s, beyond]), np.array([j, j])
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
    found = list[Place]()
    for place in sorted(places):
        last = found[-1] if found else None
        if last is not None and last.obstacle == place.obstacle and (last.lies or place.lies):
            k = mesh.node(last.end)
            if place.start - last.end <= (mesh.s[min(k + 1, mesh.steps)] - mesh.s[k]) / 10:
                found[-1] = replace(last, end=max(place.end, last.end))
                continue
        found.append(place)
    return tuple(found)


@dataclass
class _Root:
    """The search for one root, from value to value: Newton's, or secant steps between signs.

    Attributes
    ----------
    values : list of (s, f)
        In the order they came.
    """

    values: list[tuple[float, float]] = field(default_factory=list)

    def next(self, s: float, f: float, shift: float, most: float) -> float:
        """Return where to look next, after f at s; `shift` is Newton's step, `most` the longest."""
        self.values.append((s, f))
        if len(self.values) > 1:
            before, last = self.values[-2]
            if abs(f) > 0.3 * abs(last) and f != last and s != before:
                secant = -f * (s - before) / (f - last)
                shift = secant if secant * shift > 0 or f * last < 0 else shift
        shift = min(max(shift, -most), most)
        other = [own for own in self.values if own[1] * f < 0 and (own[0] - s) * shift > 0]
        if other:
            wall, value = min(other, key=lambda own: abs(own[0] - s))
            if abs(shift) > 0.98 * abs(wall - s):
                shift = f / (f - value) * (wall - s)
        return s + shift

    def is_jump(self, s: float, f: float, near: float) -> bool:
        """Return whether the function jumps across 0 as near to s, as where an obstacle ends."""
        return any(value * f < 0 and abs(at - s) < near for at, value in self.values)
