"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

From the straight arm at rest the equilibrium is followed while tensions and loads grow in
proportion. Where it ends, as where a tip slips off an edge, the arm jumps: see model.contact.jumps.
Friction looks back over each step, and over all of a jump at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.contact.held_shut import Question
from model.contact.history import History
from model.contact.jumps import jumped, placed_near, pushed
from model.contact.moving import Settled, settled
from model.contact.newton import Held, newton
from model.contact.read_off import at_nodes, close, guesses
from model.contact.stability import held_stands
from model.equilibrium.continuation import is_near
from model.equilibrium.linearised import Linearised
from model.errors import SnapError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time

# First and least steps in the share of tensions and loads: with forces at nodes, with places that
# move.
_FIRST, _ROUGH, _LEAST = 0.25, 1 / 64, 1 / 256
# The longest step with friction: as where a point rolls, which is not to count as slip.
_WITH_FRICTION = 1 / 8
# How often places may move in a step.
_SHORT = 25


@dataclass(frozen=True, eq=False)
class Followed:
    """Where an arm came to, and how.

    Attributes
    ----------
    settled : Settled
    snaps : tuple of float
        The shares of tensions and loads at which the arm jumped to another equilibrium.
    before : Linearised or None
        With friction the equilibrium before the last step.
    way : tuple
        With friction the equilibria on the way, and at which shares of it.
    """

    settled: Settled
    snaps: tuple[float, ...] = ()
    before: Linearised | None = None
    way: tuple[tuple[Linearised, float], ...] = ()


def follow(
    of: Question, before: Array, load: float, start: Settled, jumps: bool = True
) -> Followed:
    """Return where an equilibrium under tensions `before` and a load factor comes to.

    While tensions go to others in a straight line, and loads to the full. Raises
    UnsettledContactError where none is found; unless it may jump, SnapError where it would, or
    where forces at nodes do not lead there, as who asks for that comes nearer by itself.
    """
    if of.history is not None:
        return _exactly(of, before, load, start, jumps)
    held = _at_nodes_alone(of, before, load, start)
    found = None if held is None else placed_near(of, held)
    if found is not None and held_stands(found.held.here):
        return Followed(found)
    if not jumps:
        raise SnapError(0.0, "it jumps")
    return _exactly(of, before, load, start, jumps)


def _way(of: Question, before: Array, load: float, share: float) -> Question:
    """Return the question at a share of the way."""
    tensions = before + share * (of.tensions - before)
    return replace(of, tensions=tensions, load=load + share * (of.load - load))


def _at_nodes_alone(of: Question, before: Array, load: float, start: Settled) -> Held | None:
    """Return the equilibrium at the end of the way with forces at the nodes of one mesh.

    None where it would jump, be it from node to node: that it does not is told by moving places.
    """
    held, at, step = at_nodes(start.held), 0.0, _FIRST
    system = held.here.system
    while at < 1:
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        found = newton(system, on.tensions, on.load, held.states, held.touches)
        if found is not None and is_near(system, held.states, found.states):
            held, at, step = found, share, 2 * step
        elif step > _ROUGH:
            step /= 4
        else:
            return None
    return held


def _exactly(of: Question, before: Array, load: float, start: Settled, jumps: bool) -> Followed:
    """Return the end of the way with places that move; see follow."""
    frictional = of.history is not None
    longest = _WITH_FRICTION if frictional else 1.0
    here, at, step, snaps = start, 0.0, min(_FIRST, longest), list[float]()
    last, stood = here.held.here, held_stands(start.held.here)
    way = list[tuple[Linearised, float]]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        on = replace(on, history=History(here.held.here) if frictional else None)
        last = here.held.here
        found = settled(on, here.held, here.places, _SHORT) or _by_nodes(on, here.held)
        if found is not None and close(here.held, found.held):
            here, at, step = found, share, min(2 * step, longest)
            way += [(found.held.here, share)] * frictional
            if jumps and stood and not held_stands(here.held.here):
                here = jumped(on, share, Settled(pushed(here.held), here.places))
                snaps.append(share)
        elif step > _LEAST:
            step /= 4
        elif not jumps:
            raise SnapError(at, "it jumps")
        else:
            here, at, step, stood = jumped(on, share, here), share, _FIRST / 4, True
            snaps.append(share)
    return Followed(here, tuple(snaps), last if frictional else None, tuple(way))


def _by_nodes(of: Question, near: Held) -> Settled | None:
    """Return an equilibrium whose places are told by one with forces at nodes."""
    found = newton(near.here.system, of.tensions, of.load, near.states, at_nodes(near).touches)
    return None if found is None else settled(of, found, next(guesses(found)), _SHORT)
