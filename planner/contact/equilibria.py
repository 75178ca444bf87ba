"""Equilibria of an arm with contact, from rest, from others nearby, or against friction.

On meshes that have as nodes where targets look. What a search asks for again, as its certificate
does, is remembered.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from model.arm import Arm
from model.contact.forward import TouchingMap
from model.contact.rubbed import led
from model.contact.stability import held_stands
from model.contact.touches import Touches
from model.equilibrium.equilibrium import Collocated
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.errors import SnapError
from model.loads import without_friction
from model.paths import Array
from model.scene import Scene

# An arm that turns nowhere by more than this stands if it stood before and touches the same.
_STILL = 1e-3

# An equilibrium, and the shares of its load path at which the arm jumped.
Found = tuple[Linearised, tuple[float, ...]]


@dataclass(frozen=True)
class Equilibria:
    """Settles an arm on meshes of a refinement.

    Attributes
    ----------
    arm, scene
    stations : tuple of float
        Arc lengths that are nodes [m].
    refinement : int
    machine_code : bool
    history : tuple of (n_tendons,)
        With friction the load path from whose end the arm moves, in a straight line of tensions.
    """

    arm: Arm
    scene: Scene
    stations: tuple[float, ...]
    refinement: int
    machine_code: bool = False
    history: tuple[tuple[float, ...], ...] = ()

    @cached_property
    def _forward(self) -> TouchingMap:
        return self._map(self.scene)

    def _map(self, scene: Scene) -> TouchingMap:
        mesh = (STAGES, self.refinement, self.stations)
        return TouchingMap(self.arm, scene, *mesh, self.machine_code)

    @cached_property
    def _before(self) -> tuple[Array, Collocated]:
        """The tensions and the equilibrium that friction acts against the motion from.

        The first of the load path is settled without friction, as nothing is known of how the arm
        came there.
        """
        smooth, T = self._map(without_friction(self.scene)), np.array(self.history[0])
        known = smooth.equilibrium(T)
        for after in map(np.array, self.history[1:]):
            way = self._forward.led(after, T, known, False)
            T, known = after, self._known(way.settled.held.here)
        return T, known

    def at(self, tensions: Array, near: Found | None) -> Found:
        """Return the equilibrium that the arm comes to from rest, or from another.

        With friction it moves with the tensions as all of its way does. Raises SnapError where it
        comes to none, and near another where it would jump.
        """
        if self.history:
            way = self._forward.led(tensions, *self._before, False)
            return (led(way.way) if way.way else way.settled.held.here), way.snaps
        if near is None:
            return _from_rest(self, tuple(tensions.tolist()))
        if np.array_equal(tensions, near[0].tensions):
            return near
        before = near[0]
        here, snaps = self._forward.come_to(tensions, before.tensions, self._known(before), False)
        moved = before.by_tensions @ (tensions - before.tensions)
        is_still = np.abs(moved[before.system.of.nodes[:, :4]]).max() < _STILL
        same = is_still and Touches.of(here.system).like(Touches.of(before.system))
        if not same and not held_stands(here):
            raise SnapError(1.0, "it does not stand")
        return here, snaps

    def _known(self, here: Linearised) -> Collocated:
        return Collocated(here, self.refinement)

    def refined(self, tensions: Array, near: Linearised | None) -> Found:
        """Return the equilibrium under tensions from rest, or near that of another mesh."""
        return self._forward.come_to(
            tensions, tensions, None if near is None else self._known(near)
        )


# Searches ask for both of their meshes, and certificates for these again.
equilibria = lru_cache(maxsize=4)(Equilibria)


@lru_cache(maxsize=8)
def _from_rest(own: Equilibria, tensions: tuple[float, ...]) -> Found:
    """Return what an arm comes to from rest, on the coarsest mesh, and there on its own."""
    T = np.array(tensions)
    if own.refinement == 1:
        return own.refined(T, None)
    asked = own.arm, own.scene, own.stations, own.refinement // 2, own.machine_code
    here, snaps = _from_rest(equilibria(*asked), tensions)
    there, more = own.refined(T, here)
    return there, snaps or more
