"""Equilibria on a mesh under what holds the tendons: forces, or winches; what `settle` refines."""

from __future__ import annotations

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
from model.contact.forward import TouchingMap
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
        states = None if near is None else near.states
        return OnMesh(equilibrium_on(forward, self.tensions, states))

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
        tight = tightened(here, self.winches, equilibrium_beside, self.arm)
        return found if tight is None else self._of(forward, tight)

    def _of(self, forward: Collocation, here: Linearised) -> OnMesh:
        left = self._left(here.lengths, here.tensions)
        return OnMesh(Collocated(here, forward.refinement), left)

    def _left(self, lengths: Array, tensions: Array) -> Array:
        left = self.winches.lacks(lengths, tensions)
        return np.where(self.winches.held, left, np.nan)

    def _loaded(self, forward: Collocation, near: Equilibrium | None) -> Linearised:
        winches, begun = self.winches, None
        if near is not None and near.states is not None:
            T = np.where(winches.held, near.tensions, winches.tensions)
            begun = forward.near(T, near.states)
        if begun is not None:
            found = tightened(begun, winches, equilibrium_beside, self.arm, _ON_THE_WAY)
            if found is not None:
                return found
        program, found = LeastEnergy(forward.system), None
        least = least_by_lengths(program, winches)
        if least is not None:
            left = winches.lacks(program.lengths(least), least.tensions)
            T = slackened(least.tensions, left, winches, self.arm)
            begun = newton(forward.system, T, 1.0, program.states(least))
            found = begun and tightened(begun, winches, equilibrium_beside, self.arm, _ON_THE_WAY)
        if found is None:
            free = forward.found(winches.tensions)
            found = followed(free, winches, equilibrium_beside, self.arm)
        if found is None:
            raise unknown_least(self.arm, winches)
        return found

    @cached_property
    def _unloaded(self) -> Array:
        """Tensions of the arm without loads, found once: no mesh is asked for."""
        lengths = UnloadedLengths(self.arm, self.scene, self.winches, self.machine_code)
        return lengths.tensions(self.near)
