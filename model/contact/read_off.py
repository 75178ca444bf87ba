"""Places that are read off an equilibrium, to begin with nearby or on another mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from model.contact.newton import Held
from model.contact.places import Place
from model.contact.touches import Touches, forces
from model.equilibrium.linearised import Index
from model.paths import Array


def guesses(held: Held) -> Iterator[tuple[Place, ...]]:
    """Yield places to begin with, the likeliest first: what a run of nodes that touch may be.

    Runs of three or more are a part that lies, single nodes beyond a free one among them, and of
    two a point between them; else all runs are their ends, or points, or parts.
    """
    seen = list[tuple[Place, ...]]()
    for kind in (_likely, _ends, _point, _part):
        found = _places(held, kind)
        if found not in seen:
            yield found
        seen.append(found)


_Kind = Callable[[Array, Array], list[tuple[float, float]]]


def _likely(s: Array, force: Array) -> list[tuple[float, float]]:
    return (_part if s.size > 2 else _point)(s, force)


def _ends(s: Array, _: Array) -> list[tuple[float, float]]:
    return [(at, at) for at in sorted({float(s[0]), float(s[-1])})]


def _point(s: Array, force: Array) -> list[tuple[float, float]]:
    weight = np.maximum(force, 1e-300)
    return [(float(weight @ s / weight.sum()),) * 2]


def _part(s: Array, _: Array) -> list[tuple[float, float]]:
    return [(float(s[0]), float(s[-1]))]


def _places(held: Held, kind: _Kind) -> tuple[Place, ...]:
    """Return places of an equilibrium with forces at nodes."""
    system, states = held.here.system, held.states
    s, force, found = system.mesh.s, forces(system, states), list[Place]()
    for j in range(force.shape[1]):
        own = np.flatnonzero(held.touches.point[:, j])
        runs = np.split(own, np.flatnonzero(np.diff(own) > 2) + 1) if own.size else []
        for run in runs if max((r.size for r in runs), default=0) > 2 else _next_to(own):
            at_tip = run[-1] == s.size - 1 and run.size < 3
            ends = [(float(s[-1]),) * 2] if at_tip else kind(s[run], force[run, j])
            found += [Place(j, *end) for end in ends]
    return tuple(found)


def _next_to(own: Index) -> list[Index]:
    """Return runs of numbers that follow each other."""
    return np.split(own, np.flatnonzero(np.diff(own) > 1) + 1) if own.size else []


def exact_places(held: Held) -> tuple[Place, ...]:
    """Return the places where an equilibrium touches."""
    s, touches, found = held.here.system.mesh.s, held.touches, list[Place]()
    for j in range(touches.point.shape[1]):
        found += [Place(j, float(at), float(at)) for at in s[touches.point[:, j]]]
        edges = np.diff(touches.lies[:, j].astype(int), prepend=0, append=0)
        pairs = zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
        found += [Place(j, float(s[a]), float(s[b])) for a, b in pairs]
    return tuple(found)


def at_nodes(held: Held) -> Held:
    """Return an equilibrium whose contact is by forces at nodes alone."""
    touches = held.touches
    return replace(held, touches=Touches.at_points(touches.held | touches.inside))


def close(one: Held, other: Held) -> bool:
    """Return whether no frame turns far between two equilibria."""
    a, b = (held.here.system for held in (one, other))
    before, after = (system.poses(h.states) for system, h in ((a, one), (b, other)))
    there = np.array([np.interp(b.mesh.s, a.mesh.s, column) for column in before[:, :4].T]).T
    there /= np.linalg.norm(there, axis=1)[:, None]
    return bool(np.abs((there * after[:, :4]).sum(axis=1)).min() > np.cos(0.3))
