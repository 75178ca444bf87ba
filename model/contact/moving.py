"""Equilibria with contact at places that move along the arm until they are where it touches.

With all places held shut the equations are solved by Newton's method; then places move, come and
go as model.contact.shifts and model.contact.changes have it, and nodes move with them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from model.contact.changes import changed, exchanged, narrowed, split
from model.contact.held_shut import Nodes, Question, held_shut
from model.contact.newton import Held
from model.contact.places import Place
from model.contact.root import Root
from model.contact.shifts import moved
from model.contact.touches import forces
from model.equilibrium.linearised import Linearised
from model.loads import contacts

# How often places move, come or go.
_ROUNDS = 40
# How often the same places may come by others' coming and going: beyond it goes round in a circle.
_AGAIN, _DIGITS = 2, 8
# How often a move of places is halved that leads nowhere, or to where an obstacle pulls.
_HALVED = 4
# Of what presses, how near that is to be which friction is told, before friction follows it.
_TOLD = 1e-3

# How far derivatives are followed, as a change of the frames' quaternions.
_AHEAD = 0.02

_Found = tuple[Held, Nodes]
_Last = tuple[Held, Nodes, tuple[Place, ...]]


@dataclass(frozen=True, eq=False)
class Settled:
    """An equilibrium with contact, and the places where it touches."""

    held: Held
    places: tuple[Place, ...]


def settled(
    of: Question, held: Held, places: tuple[Place, ...], rounds: int = _ROUNDS
) -> Settled | None:
    """Return the equilibrium near one of which places are known about; None if none is found.

    `rounds` is how often places may move, come or go.
    """
    roots, last, halved = dict[tuple[int, int], Root](), None, 0
    seen = Counter[tuple[Place, ...]]()
    born, whole, left = tuple[Place, ...](), True, set[Place]()
    # Next to ends that are not found pressures are far off: friction begins with those before.
    pressing = held if _rubs(of, places) else None
    for _ in range(rounds):
        found = held_shut(of, held, places, pressing)
        if last is not None and halved < _HALVED and (found is None or _pulls(found, last)):
            places, halved = _between(last[2], places), halved + 1
            continue
        if found is None and any(place in born for place in places):
            fewer = narrowed(held, places, born) if whole else places
            whole = False
            if fewer == places:
                places, born = split(places, born), ()
            else:
                born = tuple(own for own, was in zip(fewer, places, strict=True) if was in born)
                places = fewer
            continue
        if found is None:
            return None
        held, nodes = found
        after = exchanged(held, places, nodes)
        if after == places:
            after = moved(held, places, nodes, roots)
        if after == places:
            after = changed(held, places, nodes, left, roots)
            if after == places and pressing is None:
                return Settled(held, places)
            if after == places:
                roots, last = {}, None
                pressing = None if _is_near(held) else held
                continue
        if _kinds(after) == _kinds(places):
            last = held, nodes, places
        else:
            seen[_rounded(after, held.length)] += 1
            if max(seen.values()) > _AGAIN:
                return None
            roots, last = {}, None
            born = tuple(place for place in after if place.lies and place not in places)
            whole = True
        places, halved = after, 0
    return None


def ahead(of: Question, there: Held, places: tuple[Place, ...]) -> tuple[Held, tuple[Place, ...]]:
    """Return about where an equilibrium that is known, and its places, move with the tensions.

    By its derivatives, unless that is far.
    """
    here = there.here
    system = here.system
    change = here.by_tensions @ (of.tensions - here.tensions)
    if np.abs(change[system.of.nodes[:, :4]]).max() > _AHEAD:
        return replace(there, factored=here), places
    x = system.x(of.tensions, of.load, here.states + change)
    held = Held(Linearised(system, x), there.touches, here)
    nodes = tuple(tuple(system.mesh.node(s) for s in place.ends) for place in places)
    return held, moved(held, places, nodes, {})


def _pulls(found: _Found, last: _Last) -> bool:
    """Return whether obstacles pull everywhere that pressed before: another branch."""
    after, before = (_first_forces(held, nodes) for held, nodes in (found, last[:2]))
    return max(after, default=0.0) < 0 < max(before)


def _first_forces(held: Held, nodes: Nodes) -> list[float]:
    """Return the force on the first node of each place."""
    force = forces(held.here.system, held.states)
    return [float(force[own[0]].sum()) for own in nodes]


def _between(one: tuple[Place, ...], other: tuple[Place, ...]) -> tuple[Place, ...]:
    """Return the places halfway between those of the same kinds."""
    return tuple(
        Place(a.obstacle, (a.start + b.start) / 2, (a.end + b.end) / 2)
        for a, b in zip(one, other, strict=True)
    )


def _kinds(places: tuple[Place, ...]) -> list[tuple[int, bool]]:
    return [(place.obstacle, place.lies) for place in places]


def _rounded(places: tuple[Place, ...], length: float) -> tuple[Place, ...]:
    """Return the places over the arm's length, alike where they are nearly the same."""
    return tuple(
        Place(p.obstacle, round(p.start / length, _DIGITS), round(p.end / length, _DIGITS))
        for p in places
    )


def _rubs(of: Question, places: tuple[Place, ...]) -> bool:
    """Return whether there is friction at a part that lies."""
    own = contacts(of.scene)
    return any(place.lies and own[place.obstacle].friction for place in places)


def _is_near(held: Held) -> bool:
    """Return whether what presses is nearly what friction was told."""
    system, told = held.here.system, held.touches.pressing
    assert told is not None
    own = held.states[system.of.touches] * (held.touches.held | held.touches.inside)[:, :, None]
    most = np.abs(own).max(axis=(0, 1))
    return bool((np.abs(own - told).max(axis=(0, 1)) <= _TOLD * most).all())
