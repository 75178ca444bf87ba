"""Where an arm comes to rest that jumps: it moves on against a viscous resistance until it stands.

These are implicit Euler steps of a body that resists changes of its strains, whose energy falls
with each, longer as it comes to rest. At first with forces at the nodes of one mesh, which come and
go at will; but a node that slides over an obstacle may catch there, where a point of the arm would
not. Then with places that move along it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from model.contact.complementary_step import complementary_step
from model.contact.drag import Drag
from model.contact.held_shut import Question, Resisted
from model.contact.moving import Settled, settled
from model.contact.newton import Held, linearised, newton
from model.contact.read_off import at_nodes, close, guesses
from model.contact.stability import held_stability, held_stands, least_mode
from model.contact.touches import Touches
from model.equilibrium.forward import carried_strains
from model.equilibrium.linearised import Linearised
from model.errors import UnsettledContactError
from model.paths import Array
from model.time_limit import check_time

# Steps against resistance: how many, how far one may turn a frame, resistance to begin with, the
# least and the most, and with how little Newton's method is tried, once in so many steps.
_FLOWS, _TURN, _THICK, _THIN, _STUCK, _LITTLE, _TRIED = 200, 0.15, 1.0, 1e-2, 1e6, 0.1, 4
# Resistance over the stability that an equilibrium lacks, so that steps lead away from it; how much
# of a step leads back if the next is so much against it, and by what the least resistance falls.
_AWAY, _BACK, _EASED = 3.0, 0.3, 1.2
# How far along its least mode an arm that does not stand is pushed, as a change of strains, 1 / L.
_PUSHED = 1e-3
# With places that move: how many steps, and how often these may move in each.
_SLIDES, _SHORT = 60, 12


def jumped(of: Question, share: float, here: Settled) -> Settled:
    """Return the equilibrium that an arm jumps to at a share of the way.

    Raises UnsettledContactError where it finds none.
    """
    held = at_nodes(here.held)
    rest = _relaxed(_AtNodes(of, held, held.states, held.touches), _FLOWS)
    if rest is not None and (found := placed_near(of, rest.held)) is not None:
        return found
    slid = _relaxed(_Placed(of, here), _SLIDES)
    if slid is None:
        raise UnsettledContactError(share, "it jumps, and does not come to rest")
    return slid.here


def placed_near(of: Question, held: Held) -> Settled | None:
    """Return the equilibrium near one with forces at nodes; None if none is found."""
    found = (settled(of, held, places) for places in guesses(held))
    return next((one for one in found if one is not None and close(held, one.held)), None)


def pushed(held: Held) -> Held:
    """Return an equilibrium that does not stand, pushed off a little."""
    x = held.here.x.copy()
    x[held.here.system.of.first :] += _PUSHED * least_mode(held.here)
    return Held(Linearised(held.here.system, x), held.touches)


@dataclass(frozen=True, eq=False)
class _AtNodes:
    """An arm that moves with forces at the nodes of one mesh."""

    of: Question
    held: Held
    states: Array
    touches: Touches

    @property
    def strains(self) -> Array:
        """Its strains (n,)."""
        return self.states[np.ravel(self.held.here.system.of.stages)]

    def moved(self, share: float) -> _AtNodes | None:
        """Return it after a step against so much resistance; None if that is no step."""
        of, system = self.of, self.held.here.system
        told = self.states, self.touches, Drag(share, self.states)
        step = complementary_step(linearised(system, of.tensions, of.load, *told), self.touches)
        if step is None or np.abs(step[0][system.of.nodes[:, :4]]).max() > _TURN:
            return None
        return replace(self, states=self.states + step[0], touches=step[1])

    @property
    def at_rest(self) -> _AtNodes | None:
        """The equilibrium nearby; None if there is none."""
        of, system = self.of, self.held.here.system
        found = newton(system, of.tensions, of.load, self.states, self.touches)
        return None if found is None else _AtNodes(of, found, found.states, found.touches)


@dataclass(frozen=True, eq=False)
class _Placed:
    """An arm that moves with places that move along it."""

    of: Question
    here: Settled

    @property
    def held(self) -> Held:
        """Where it is."""
        return self.here.held

    @property
    def strains(self) -> Array:
        """Its strains (n,) at the stages of the mesh that nodes are moved from."""
        system, after = self.held.here.system, self.of.system(self.of.base)
        return np.ravel(carried_strains(system, system.strains(self.held.states), after))

    def moved(self, share: float) -> _Placed | None:
        """Return it after a step against so much resistance; None if that is no step."""
        of = replace(self.of, resisted=Resisted(share, self.held))
        found = settled(of, self.held, self.here.places, _SHORT)
        if found is None or not close(self.held, found.held):
            return None
        return replace(self, here=found)

    @property
    def at_rest(self) -> _Placed | None:
        """The equilibrium nearby; None if there is none."""
        found = settled(self.of, self.held, self.here.places, _SHORT)
        if found is None or not close(self.held, found.held):
            return None
        return replace(self, here=found)


S = TypeVar("S", _AtNodes, _Placed)


def _relaxed(begin: S, most: int) -> S | None:
    """Return the equilibrium that an arm comes to against a viscous resistance.

    None if to none in so many steps.
    """
    now, share, floor = begin, _THICK, _THIN
    last = 0 * begin.strains
    for count in range(most):
        check_time()
        if share > _STUCK:
            break
        there: S | None = now.moved(share)
        if there is None:
            share *= 4
            continue
        own = there.strains - now.strains
        if own @ last < -_BACK * max(own @ own, last @ last):
            # With less resistance than the arm lacks stability, steps lead back.
            floor, share, last = 4 * share, 4 * share, 0 * own
            continue
        now, last = there, own
        share, floor = max(share / 2, floor), max(floor / _EASED, _THIN)
        if share <= _LITTLE and count % _TRIED == 0:
            found: S | None = now.at_rest
            if found is not None and held_stands(found.held.here):
                return found
            if found is not None:
                floor = share = _AWAY * max(-held_stability(found.held.here), _THIN)
    return None
