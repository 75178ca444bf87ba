"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

From the straight arm at rest the least energy with gaps >= 0 at the nodes is followed while
tensions and loads grow in proportion. Where frames turn far in however short a step the minimum was
lost, and the arm has snapped to the next one. At the end the places where it touches are found by
Newton's method; see model.contact.moving. With friction, which looks back over each step, places
are followed all the way; over a snap it slides without.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.by_lengths import slackened
from model.contact.held_shut import Question
from model.contact.history import History
from model.contact.moving import Settled, settled
from model.contact.newton import Held, newton
from model.contact.passing import gaps_along
from model.contact.read_off import close, guesses
from model.contact.stability import held_stands
from model.contact.touches import Touches
from model.equilibrium.continuation import is_near
from model.equilibrium.forward import carried_strains
from model.equilibrium.linearised import Linearised
from model.errors import SnapError, UnsettledContactError
from model.least_energy.program import LeastEnergy, Minimum
from model.loads import without_friction
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System
from model.winches import Winches, rest_lengths

# First and least steps in the share of tensions and loads.
_FIRST, _LEAST = 0.25, 1 / 64
# The farthest that a frame may turn in one [rad].
_TURN = 1.0
# The longest step with friction, as where a point rolls, which is not to count as slip; and the
# least.
_WITH_FRICTION, _FINEST = 1 / 8, 1 / 128
# How often places may move in a step with friction.
_SHORT = 25
# Forces over the largest that are those of an interior point.
_NONE = 1e-5


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
    UnsettledContactError where none is found; unless it may jump, SnapError where it would.
    """
    if of.history is not None:
        return _with_friction(of, before, load, start, jumps)
    here, snaps = _least_energy(of, before, load, start)
    if snaps and not jumps:
        raise SnapError(snaps[0], "it jumps")
    return Followed(here, snaps)


def by_lengths(of: Question, winches: Winches) -> Settled | None:
    """Return the equilibrium whose tendons winches hold, by steps of strokes and loads from rest.

    Tensions are those of the least energy with forces at nodes. None where none is found.
    """
    program, rest = LeastEnergy(of.system(of.base)), rest_lengths(of.arm)
    here, longest = program.at_rest(), np.maximum(rest, winches.lengths)
    for share in np.arange(_FIRST, 1 + _FIRST, _FIRST).tolist():
        check_time()
        part = replace(winches, lengths=longest + share * (winches.lengths - longest))
        found = program.least(here, share * winches.tensions, share, part)
        if found is None:
            return None
        here = found
    left = winches.lacks(program.lengths(here), here.tensions)
    T = slackened(here.tensions, left, winches, of.arm)
    return _placed(replace(of, tensions=T), program, replace(here, tensions=T))


def _least_energy(
    of: Question, before: Array, load: float, start: Settled
) -> tuple[Settled, tuple[float, ...]]:
    """Return the equilibrium at the end of the way, and the shares at which the arm snaps."""
    program = LeastEnergy(of.system(of.base))
    old = start.held.here.system
    strains = carried_strains(old, old.strains(start.held.states), program.system)
    at, T = 0.0, before
    if not start.places:
        at, T, strains = _free(of, program.system, before, load, strains)
    here, step, snaps = program.near(T, strains), _FIRST, list[float]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        found = program.least(here, on.tensions, on.load)
        far = found is None or not _is_near(program, here, found)
        if far and step > _LEAST:
            step /= 2
            continue
        if found is None:
            raise UnsettledContactError(share, "no least energy is found")
        if far:
            snaps.append(share)
        here, at, step = found, share, 2 * step
    return _placed(of, program, here), tuple(snaps)


def _free(
    of: Question, system: System, before: Array, load: float, strains: Array
) -> tuple[float, Array, Array]:
    """Return how far the arm comes without touching anything, tensions and strains there.

    By Newton's method, in steps in which no frame turns far; nothing touches at the end of each.
    """
    at, T, step = 0.0, before, _FIRST
    none = Touches.none(system.of.elements, system.of.form.contacts)
    states = system.start(before, strains, load)
    while at < 1:
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        found = newton(system, on.tensions, on.load, states, none)
        near = found is not None and is_near(system, states, found.states)
        if found is not None and near and gaps_along(system, found.states)[1].min() > 0:
            at, T, states, step = share, on.tensions, found.states, 2 * step
        elif step > _LEAST and not near:
            step /= 4
        else:
            break
    return at, T, system.strains(states)


def _is_near(program: LeastEnergy, one: Minimum, other: Minimum) -> bool:
    a, b = (program.nodes(here)[:, :4] for here in (one, other))
    return bool(np.abs((a * b).sum(axis=1)).min() > np.cos(_TURN / 2))


def _placed(of: Question, program: LeastEnergy, here: Minimum) -> Settled:
    """Return the equilibrium with contact at places that move, near one with forces at nodes."""
    system, most = program.system, here.forces.max(initial=0.0)
    point = np.vstack([np.zeros((1, here.forces.shape[1]), bool), here.forces > _NONE * most])
    touches = Touches.at_points(point)
    told = touches.told(system)
    held = Held(Linearised(told, told.x(here.tensions, of.load, program.states(here))), touches)
    for places in guesses(held):
        found = settled(of, held, places)
        if found is not None and close(held, found.held) and held_stands(found.held.here):
            return found
    raise UnsettledContactError(1.0, "where it touches is not found")


def _way(of: Question, before: Array, load: float, share: float) -> Question:
    """Return the question at a share of the way."""
    tensions = before + share * (of.tensions - before)
    return replace(of, tensions=tensions, load=load + share * (of.load - load))


def _with_friction(
    of: Question, before: Array, load: float, start: Settled, jumps: bool
) -> Followed:
    """Return the end of the way with friction, which looks back over each step; see follow."""
    here, at, step, snaps = start, 0.0, _WITH_FRICTION, list[float]()
    last, way = start.held.here, list[tuple[Linearised, float]]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        on = replace(_way(of, before, load, share), history=History(here.held.here))
        last = here.held.here
        found = settled(on, here.held, here.places, _SHORT)
        if found is not None and close(here.held, found.held):
            here, at, step = found, share, min(2 * step, _WITH_FRICTION)
        elif step > _FINEST:
            step /= 4
            continue
        elif not jumps:
            raise SnapError(at, "it jumps")
        else:
            here, at, step = _slid(on, here), share, _WITH_FRICTION
            snaps.append(share)
        way.append((here.held.here, share))
    return Followed(here, tuple(snaps), last, tuple(way))


def _slid(of: Question, here: Settled) -> Settled:
    """Return the equilibrium with friction near that which the arm without it snaps to."""
    smooth = replace(of, scene=without_friction(of.scene), history=None)
    there, _ = _least_energy(smooth, of.tensions, of.load, here)
    found = settled(of, there.held, there.places)
    if found is None:
        raise UnsettledContactError(1.0, "where it comes to rest with friction is not found")
    return found
