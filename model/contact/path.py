"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

From the straight arm at rest the equilibrium is followed while tensions and loads grow in
proportion. Where it ends, as where a tip slips off an edge, the arm moves on against a viscous
resistance until it stands again: implicit Euler steps of a body that resists changes of its
strains, whose energy falls with each, longer as it comes to rest. Friction looks back over each
step, and over all of a jump at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.contact.history import History
from model.contact.moving import Question, Settled, settled
from model.contact.newton import Drag, Held, complementary_step, newton
from model.contact.read_off import at_nodes, close, guesses
from model.contact.stability import held_stability, held_stands, least_mode
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_stepping import is_near
from model.errors import SnapError, UnsettledContactError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System

# First and least steps in the share of tensions and loads: with forces at nodes, with places that
# move.
_FIRST, _ROUGH, _LEAST = 0.25, 1 / 64, 1 / 256
# The least where it may not jump: who asks for that comes nearer by itself.
_LEAST_NEARBY = 1 / 16
# The longest step with friction: as where a point rolls, which is not to count as slip.
_WITH_FRICTION = 1 / 8
# How often places may move in a step.
_SHORT = 25
# Steps against resistance: how many, how far one may turn a frame, resistance to begin with, the
# least and the most, and with how little Newton's method is tried, once in so many steps.
_FLOWS, _TURN, _THICK, _THIN, _STUCK, _LITTLE, _TRIED = 200, 0.15, 1.0, 1e-2, 1e9, 0.1, 4
# Resistance over the stability that an equilibrium lacks, so that steps lead away from it; how much
# of a step leads back if the next is so much against it, and by what the least resistance falls.
_AWAY, _BACK, _EASED = 3.0, 0.3, 1.2
# How far along its least mode an arm that does not stand is pushed, as a change of strains, 1 / L.
_PUSHED = 1e-3


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

    While tensions go to others in a straight line, and loads to the full.
    Raises UnsettledContactError where none is found, SnapError where it would jump unless it may.
    """
    if of.history is not None:
        return _exactly(of, before, load, start, jumps)
    held = _at_nodes_alone(of, before, load, start)
    found = None if held is None else _placed(of, held)
    if found is not None and held_stands(found.held.here):
        return Followed(found)
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
    least = _LEAST if jumps or frictional else _LEAST_NEARBY
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
                here = _jumped(on, share, _pushed(here.held))
                snaps.append(share)
        elif step > least:
            step /= 4
        elif not jumps:
            raise SnapError(at, "it jumps")
        else:
            here, at, step, stood = _jumped(on, share, here.held), share, _FIRST / 4, True
            snaps.append(share)
    return Followed(here, tuple(snaps), last if frictional else None, tuple(way))


def _placed(of: Question, held: Held) -> Settled | None:
    """Return the equilibrium near one with forces at nodes; None if none is found."""
    found = (settled(of, held, places) for places in guesses(held))
    return next((one for one in found if one is not None and close(held, one.held)), None)


def _by_nodes(of: Question, near: Held) -> Settled | None:
    """Return an equilibrium whose places are told by one with forces at nodes."""
    found = newton(near.here.system, of.tensions, of.load, near.states, at_nodes(near).touches)
    return None if found is None else settled(of, found, next(guesses(found)), _SHORT)


def _jumped(of: Question, share: float, held: Held) -> Settled:
    """Return the equilibrium that an arm jumps to at a share of the way.

    Raises UnsettledContactError where it finds none.
    """
    rest = relaxed(held.here.system, of.tensions, of.load, at_nodes(held))
    if rest is None:
        raise UnsettledContactError(share, "it jumps, and does not come to rest")
    found = _placed(of, rest)
    if found is None:
        raise UnsettledContactError(share, "it jumps, and where it touches then is not found")
    return found


def relaxed(system: System, tensions: Array, load: float, held: Held) -> Held | None:
    """Return the equilibrium that an arm comes to against a viscous resistance; None if to none."""
    states, touches, share, floor = held.states, held.touches, _THICK, _THIN
    stages, last = np.ravel(system.of.stages), np.zeros(system.of.stages.size)
    for count in range(_FLOWS):
        check_time()
        if share > _STUCK:
            break
        step = complementary_step(system, tensions, load, states, touches, Drag(share, states))
        if step is None or np.abs(step[0][system.of.nodes[:, :4]]).max() > _TURN:
            share *= 4
            continue
        own = step[0][stages]
        if own @ last < -_BACK * max(own @ own, last @ last):
            # With less resistance than the arm lacks stability, steps lead back.
            floor, share, last = 4 * share, 4 * share, 0 * own
            continue
        states, touches, last = states + step[0], step[1], own
        share, floor = max(share / 2, floor), max(floor / _EASED, _THIN)
        if share <= _LITTLE and count % _TRIED == 0:
            found = newton(system, tensions, load, states, touches)
            if found is not None and held_stands(found.here):
                return found
            if found is not None:
                floor = share = _AWAY * max(-held_stability(found.here), _THIN)
    return None


def _pushed(held: Held) -> Held:
    """Return an equilibrium that does not stand, pushed off a little."""
    x = held.here.x.copy()
    x[held.here.system.of.first :] += _PUSHED * least_mode(held.here)
    return Held(Linearised(held.here.system, x), held.touches)
