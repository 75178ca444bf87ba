"""Equilibria on a mesh under what holds the tendons: forces, or winches; what `settle` refines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from model.arm import Arm
from model.by_lengths import (
    UnloadedLengths,
    equilibrium_beside,
    followed,
    least_by_lengths,
    slackened,
    tightened,
)
from model.contact.forward import Touching, TouchingMap
from model.equilibrium.equilibrium import Collocated, Equilibrium
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.forward import ForwardMap, equilibrium_on
from model.least_energy.program import LeastEnergy
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.shortest import unknown_least
from model.unloaded.marched import Marched
from model.winches import Winches

# What lengths may be off over the arm's length on meshes that are not the last one.
_ON_THE_WAY = 1e-9


class OnMesh(NamedTuple):
    """An equilibrium on a mesh.

    Attributes
    ----------
    equilibrium : Equilibrium
    left : (n_tendons,)
        What is left of held tendons beyond their paths [m], nan of others; None without any.
    """

    equilibrium: Equilibrium
    left: Array | None = None


@dataclass(frozen=True, eq=False)
class GivenTensions:
    """Tensions that motors hold."""

    tensions: Array
    winches: None = None

    def on(self, forward: ForwardMap, near: Equilibrium | None) -> OnMesh:
        """Return the equilibrium on the mesh of a forward map, near that of another if given."""
        if isinstance(forward, TouchingMap):
            return OnMesh(forward.from_touching(self.tensions, near))
        if isinstance(forward, Collocation):
            return OnMesh(forward.equilibrium(self.tensions, None if near is None else near.states))
        return OnMesh(Marched.under(forward, self.tensions))

    def finished(self, forward: ForwardMap, found: OnMesh) -> OnMesh:
        """Return an equilibrium that is accepted, to rounding: it is."""
        return found


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, of some tendons or all.

    Attributes
    ----------
    near : (n_tendons,)
        Tensions to begin with.
    """

    arm: Arm
    scene: Scene
    winches: Winches
    machine_code: bool = False
    near: Array | None = None

    def on(self, forward: ForwardMap, near: Equilibrium | None) -> OnMesh:
        """See GivenTensions.on; raises InputError where no shape has the lengths."""
        if not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            T = self._unloaded
            lengths = UnloadedLengths(self.arm, self.scene, self.winches, self.machine_code)
            return OnMesh(equilibrium_on(forward, T), self._left(lengths.at(T).lengths, T))
        return self._of(forward, self._loaded(forward, near))

    def finished(self, forward: ForwardMap, found: OnMesh) -> OnMesh:
        """Return an equilibrium that is accepted, its tensions found to rounding."""
        here = found.equilibrium.states
        if here is None or not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            return found
        tight = tightened(here, self.winches, _beside(forward), self.arm)
        return found if tight is None else self._of(forward, tight)

    def _of(self, forward: Collocation, here: Linearised) -> OnMesh:
        left = self._left(here.lengths, here.tensions)
        own = Touching if isinstance(forward, TouchingMap) else Collocated
        return OnMesh(own(here, forward.refinement), left)

    def _left(self, lengths: Array, tensions: Array) -> Array:
        left = self.winches.lacks(lengths, tensions)
        return np.where(self.winches.held, left, np.nan)

    def _loaded(self, forward: Collocation, near: Equilibrium | None) -> Linearised:
        winches, begun, beside = self.winches, None, _beside(forward)
        if near is not None and near.states is not None:
            T = np.where(winches.held, near.tensions, winches.tensions)
            if isinstance(forward, TouchingMap):
                begun = forward.from_touching(T, near).here
            else:
                begun = forward.near(T, near.states)
        found = begun and tightened(begun, winches, beside, self.arm, _ON_THE_WAY)
        if found is not None:
            return found
        begun = self._from_rest(forward)
        found = begun and tightened(begun, winches, beside, self.arm, _ON_THE_WAY)
        if found is None:
            free = forward.found(winches.tensions)
            found = followed(free, winches, beside, self.arm)
        if found is None:
            raise unknown_least(self.arm, winches)
        return found

    def _from_rest(self, forward: Collocation) -> Linearised | None:
        """Return the equilibrium under about the tensions by lengths; None if none is found."""
        if isinstance(forward, TouchingMap):
            return forward.by_lengths(self.winches)
        program = LeastEnergy(forward.system)
        least = least_by_lengths(program, self.winches)
        if least is None:
            return None
        left = self.winches.lacks(program.lengths(least), least.tensions)
        T = slackened(least.tensions, left, self.winches, self.arm)
        return newton(forward.system, T, 1.0, program.states(least))

    @cached_property
    def _unloaded(self) -> Array:
        """Tensions of the arm without loads, found once: no mesh is asked for."""
        lengths = UnloadedLengths(self.arm, self.scene, self.winches, self.machine_code)
        return lengths.tensions(self.near)


def _beside(forward: Collocation) -> Callable[[Linearised, Array], Linearised | None]:
    """Return what leads from an equilibrium to that under tensions near its own."""
    return forward.beside if isinstance(forward, TouchingMap) else equilibrium_beside
