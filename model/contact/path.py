"""How an arm comes to lean on things: tensions and loads grow together from none, obstacles there.

From the straight arm at rest the equilibrium is followed while tensions and loads grow in
proportion. Where it ends, as where a tip slips off an edge, the arm moves on against a viscous
resistance until it stands again: implicit Euler steps of a body that resists changes of its
strains, whose energy falls with each, longer as it comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.contact.newton import Drag, Held, complementary_step, newton
from model.contact.stability import held_stability, held_stands
from model.contact.touches import Touches
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_stepping import is_near
from model.errors import SnapError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System

# First and least step in the share of tensions and loads.
_FIRST, _LEAST = 0.25, 1 / 256
# Steps against resistance: how many, how far one may turn a frame, resistance to begin with, the
# least and the most, and in how many steps Newton's method is tried once.
_FLOWS, _TURN, _THICK, _THIN, _STUCK, _TRIED = 200, 0.15, 1.0, 1e-2, 1e9, 4
# Resistance over the stability that an equilibrium lacks, so that steps lead away from it.
_AWAY = 3.0
# How far along its least mode an arm that does not stand is pushed, as a change of the strains over
# 1 / L.
_PUSHED = 1e-3


@dataclass(frozen=True, eq=False)
class Followed:
    """Where an arm came to, and how.

    Attributes
    ----------
    held : Held
    snaps : tuple of float
        The shares of tensions and loads at which the arm jumped to another equilibrium.
    """

    held: Held
    snaps: tuple[float, ...] = ()


def from_rest(system: System, tensions: Array, rest: Array) -> Followed:
    """Return the equilibrium that the arm comes to from its states at rest.

    Raises SnapError where none is found.
    """
    none = Touches.none(system.of.elements, system.of.form.contacts)
    held = newton(system, 0 * tensions, 0.0, rest, none)
    if held is None:
        raise SnapError(0.0, "it does not come to rest without them")
    return follow(system, 0 * tensions, tensions, held, 0.0)


def follow(
    system: System, before: Array, tensions: Array, held: Held, load: float, jumps: bool = True
) -> Followed:
    """Return where an equilibrium under tensions `before` and a load factor comes to.

    While tensions go to others in a straight line, and loads to the full.
    Raises SnapError where none is found, and where the arm would jump unless it may.
    """
    at, step, snaps = 0.0, _FIRST, list[float]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        now = before + share * (tensions - before), load + share * (1 - load)
        found = newton(system, *now, held.states, held.touches)
        if found is not None and is_near(system, held.states, found.states):
            held, at, step = found, share, 2 * step
        elif step > _LEAST:
            step /= 4
        elif not jumps:
            raise SnapError(at, "it jumps")
        else:
            held, at, step = relaxed(system, *now, held), share, _FIRST / 4
            snaps.append(share)
    if jumps and not held_stands(held.here):
        held = relaxed(system, tensions, 1.0, _pushed(held))
        snaps.append(1.0)
    return Followed(held, tuple(snaps))


def relaxed(system: System, tensions: Array, load: float, held: Held) -> Held:
    """Return the equilibrium that an arm comes to against a viscous resistance.

    Raises SnapError where it comes to none.
    """
    states, touches, share, floor = held.states, held.touches, _THICK, _THIN
    for count in range(_FLOWS):
        check_time()
        step = complementary_step(system, tensions, load, states, touches, Drag(share, states))
        if step is None or np.abs(step[0][system.of.nodes[:, :4]]).max() > _TURN:
            share *= 4
            if share > _STUCK:
                break
            continue
        states, touches = states + step[0], step[1]
        share = max(share / 2, floor)
        if share == floor and count % _TRIED == 0:
            found = newton(system, tensions, load, states, touches)
            if found is not None and held_stands(found.here):
                return found
            if found is not None:
                # With less resistance than this steps lead back to where it does not stand.
                floor = share = _AWAY * max(-held_stability(found.here), _THIN)
    raise SnapError(load, "it finds no place to rest")


def _pushed(held: Held) -> Held:
    """Return an equilibrium that does not stand, pushed off a little."""
    system = held.here.system
    rng = np.random.default_rng(0)
    states = held.states.copy()
    stages = system.of.stages
    states[stages] += _PUSHED / system.arm.length * rng.standard_normal(stages.shape)
    x = np.concatenate([held.here.x[: system.of.first], states])
    return Held(Linearised(system, x), held.touches)
