"""The forward map of a scene with contact: tensions to states on a mesh that moves with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model.arm import Arm
from model.contact.held_shut import Question
from model.contact.history import History
from model.contact.meshes import mesh_with_contact
from model.contact.moving import Settled, ahead, settled
from model.contact.newton import Held, newton
from model.contact.outside import check_outside
from model.contact.path import Followed, by_lengths, follow
from model.contact.read_off import close, exact_places
from model.contact.touches import Touches
from model.equilibrium.equilibrium import Collocated, Equilibrium
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.errors import InputError, SnapError, UnsettledContactError
from model.loads import without_friction
from model.paths import Array
from model.scene import Scene
from model.transcription.neighbours import landmarks
from model.transcription.system import System
from model.winches import Winches


@dataclass(frozen=True, eq=False)
class Touching(Collocated):
    """An equilibrium with contact, whose equations know what touches on their mesh.

    Attributes
    ----------
    snaps : tuple of float
        At which shares of the way the arm jumped.
    before : Linearised or None
        With friction of contacts, the equilibrium before the last step: what has slipped since.
    """

    snaps: tuple[float, ...] = ()
    before: Linearised | None = None

    @property
    def history(self) -> History | None:
        """What friction knows of the motion before."""
        return None if self.before is None else History(self.before)


class TouchingMap(Collocation):
    """The equations of an arm that may touch obstacles, on a mesh that moves with the contacts."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        stages: int,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        base = mesh_with_contact(arm, scene, refinement, at)
        self._form = stages, refinement, at, machine_code
        self.refinement = refinement
        self._state(System(arm, scene, base, stages, True, machine_code))
        self._fixed, self._machine_code = np.unique(landmarks(arm, scene, at)), machine_code
        self._rest = self.without_loads(np.zeros(arm.n_tendons))
        check_outside(self.system, self._rest)

    def from_touching(self, tensions: Array, near: Equilibrium | None) -> Touching:
        """Return the equilibrium under tensions from rest, or from another; see led."""
        known = near if isinstance(near, Collocated) else None
        before = tensions if near is None else near.tensions
        way = self.led(tensions, before, known)
        return Touching(way.settled.held.here, self.refinement, way.snaps, way.before)

    def equilibrium(self, tensions: Array, near: Linearised | None = None) -> Collocated:
        """See Collocation.equilibrium; raises UnsettledContactError."""
        known = None if near is None else Collocated(near, self.refinement)
        return self.from_touching(tensions, known)

    def found(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        return self.equilibrium(tensions, known).here

    def come_to(
        self, tensions: Array, before: Array, known: Collocated | None, jumps: bool = True
    ) -> tuple[Linearised, tuple[float, ...]]:
        """Return the equilibrium that the arm comes to, and at which shares of the way it snaps.

        From rest, or from what is `known`, which is an equilibrium under the tensions `before`.
        Raises UnsettledContactError where none is found, SnapError where it would jump unless it
        may.
        """
        way = self.led(tensions, before, known, jumps)
        return way.settled.held.here, way.snaps

    def led(
        self, tensions: Array, before: Array, known: Collocated | None, jumps: bool = True
    ) -> Followed:
        """Return where the arm comes to, and how; see come_to.

        With friction it acts against the steps from what is known; an arm without that history has
        none as long as it touches nothing: else InputError.
        """
        of, frictional = self._question(tensions), self.system.of.form.contact_friction
        if known is None:
            if frictional:
                return self._untouched(tensions)
            return follow(of, 0 * tensions, 0.0, self._at_rest(of))
        there = Held(known.here, Touches.of(known.system))
        start, stays = Settled(there, exact_places(there)), np.array_equal(tensions, before)
        if frictional:
            past = known.history if isinstance(known, Touching) and stays else None
            own = past or History(there.here)
            of = replace(of, history=own)
        if stays or not frictional:
            near = (there, start.places) if frictional else ahead(of, there, start.places)
            found = settled(of, *near)
            if found is not None and close(there, found.held):
                if of.history is None:
                    return Followed(found)
                last = of.history.here
                return Followed(found, (), found.held.here if last is there.here else last)
        return follow(of, before, 1.0, start, jumps)

    def by_lengths(self, winches: Winches) -> Linearised | None:
        """Return the equilibrium about where winches hold the tendons; None if none is found."""
        found = by_lengths(self._question(winches.tensions), winches)
        return None if found is None else found.held.here

    def beside(self, at: Linearised, tensions: Array) -> Linearised | None:
        """Return the equilibrium under tensions near those of another; None where it jumps."""
        try:
            known = Collocated(at, self.refinement)
            return self.led(tensions, at.tensions, known, False).settled.held.here
        except (SnapError, UnsettledContactError):
            return None

    def _untouched(self, tensions: Array) -> Followed:
        """Return the equilibrium of an arm from rest that touches nothing; InputError else."""
        here, snaps = self._smooth.come_to(tensions, tensions, None)
        touches = Touches.of(here.system)
        if (touches.held | touches.inside).any():
            allowed = (
                "the shape of the same arm that it moved from: friction acts against the motion "
                "before, and an arm without history has none"
            )
            raise InputError("near", None, allowed)
        states = self.carried(tensions, here)
        none = Touches.none(self.system.of.elements, self.system.of.form.contacts)
        held = newton(self.system, tensions, 1.0, states, none)
        if held is None:
            raise UnsettledContactError(1.0, "none is found on a mesh with friction")
        return Followed(Settled(held, ()), snaps, held.here)

    @cached_property
    def _smooth(self) -> TouchingMap:
        """The map of the scene without friction of contacts."""
        scene = without_friction(self.system.scene)
        return TouchingMap(self.system.arm, scene, *self._form)

    def _question(self, tensions: Array) -> Question:
        system = self.system
        mesh = system.mesh, self._fixed
        form = system.of.form.stages, self._machine_code
        return Question(system.arm, system.scene, *mesh, tensions, 1.0, *form)

    def _at_rest(self, of: Question) -> Settled:
        """Return the arm without tensions and loads; raises UnsettledContactError."""
        form = self.system.of
        none = Touches.none(form.elements, form.form.contacts)
        held = newton(self.system, 0 * of.tensions, 0.0, self._rest, none)
        if held is None:
            raise UnsettledContactError(0.0, "it does not come to rest")
        return Settled(held, ())
