"""The forward map of a scene with contact: tensions to states on a mesh that moves with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model.arm import Arm
from model.contact.codes import codes, read_codes
from model.contact.held_shut import Question
from model.contact.history import History
from model.contact.meshes import mesh_with_contact
from model.contact.moving import Settled, ahead, settled
from model.contact.newton import Held, newton
from model.contact.outside import check_outside
from model.contact.path import Followed, follow
from model.contact.read_off import close, exact_places
from model.contact.touches import Touches
from model.effects import Contact
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised
from model.errors import InputError, UnsettledContactError
from model.mesh import with_nodes
from model.paths import Array
from model.scene import Scene
from model.transcription.neighbours import landmarks
from model.transcription.system import System


@dataclass(frozen=True, eq=False)
class KnownContact(Known):
    """States of an equilibrium with contact on some mesh, how its nodes touch, and where it was.

    `here` is the equilibrium with derivatives that are worked out already, if there is one.
    """

    touches: Touches
    history: History | None = None
    here: Linearised | None = None


class TouchingMap(Collocation):
    """See ForwardMap; a row of its states is followed by its arc length and how it touches."""

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
        self._state(System(arm, scene, base, stages, True, machine_code))
        self._fixed, self._machine_code = np.unique(landmarks(arm, scene, at)), machine_code
        self._last: tuple[Array, Collocation] | None = None
        self._rest = self.without_loads(np.zeros(arm.n_tendons))
        check_outside(self.system, self._rest)

    def run(self, tensions: Array, near: Known | None = None) -> tuple[Array, Array]:
        """See ForwardMap.run; raises UnsettledContactError."""
        return self.rows(self.found(tensions, near))

    def found(self, tensions: Array, known: Known | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        return self.come_to(tensions, tensions, known)[0]

    def come_to(
        self, tensions: Array, before: Array, known: Known | None, jumps: bool = True
    ) -> tuple[Linearised, tuple[float, ...]]:
        """Return the equilibrium that the arm comes to, and at which shares of the way it snaps.

        From rest, or from what is `known`, which is an equilibrium under the tensions `before`.
        Raises UnsettledContactError where none is found, SnapError where it would jump unless it
        may.
        """
        way = self.led(tensions, before, known, jumps)
        return way.settled.held.here, way.snaps

    def led(
        self, tensions: Array, before: Array, known: Known | None, jumps: bool = True
    ) -> Followed:
        """Return where the arm comes to, and how; see come_to.

        With friction it acts against the steps from what is known; an arm without that history has
        none as long as it touches nothing: else InputError.
        """
        of, frictional = self._question(tensions), self.system.of.form.contact_friction
        if not isinstance(known, KnownContact):
            if frictional:
                return self._untouched(tensions)
            return follow(of, 0 * tensions, 0.0, self._at_rest(of))
        there = _held(known, before)
        start, stays = Settled(there, exact_places(there)), np.array_equal(tensions, before)
        if frictional:
            own = known.history if stays and known.history else History(there.here)
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
        states = self.carried(tensions, Known(here.system, here.states))
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

    def rows(self, here: Linearised) -> tuple[Array, Array]:
        """See Collocation.rows."""
        rows, stretch = Collocation.on(here.system).rows(here)
        return np.hstack([rows, codes(here.system)]), stretch

    def known(self, rows: Array, before: tuple[Array, Array] | None = None) -> Known:
        """See ForwardMap.known; `before` are tensions and rows of the equilibrium before."""
        system, touches = self._read(rows)
        states, history = Collocation.on(system).states(rows), None
        if before is not None:
            own = self._read(before[1])[0]
            x = own.x(before[0], 1.0, Collocation.on(own).states(before[1]))
            history = History(Linearised(own, x))
        return KnownContact(system, states, touches, history)

    def settled(self, rows: Array) -> Collocation:
        """Return the map on the mesh that rows have, told of what touches there."""
        if self._last is None or self._last[0] is not rows:
            self._last = rows, Collocation.on(self._read(rows)[0])
        return self._last[1]

    def _read(self, rows: Array) -> tuple[System, Touches]:
        """Return the equations of rows, told of their touches."""
        own = self.system
        s, touches = read_codes(rows[:, own.of.stride :])
        form = own.of.form.stages, True, self._machine_code, touches.pressed
        return touches.told(System(own.arm, own.scene, with_nodes(own.arm, s), *form)), touches


def without_friction(scene: Scene) -> Scene:
    """Return a scene whose contacts have no friction."""
    free = [replace(e, friction=0.0) if isinstance(e, Contact) else e for e in scene.effects]
    return Scene(*free)


def _held(known: KnownContact, tensions: Array) -> Held:
    """Return an equilibrium that is known."""
    system = known.system
    here = known.here or Linearised(system, system.x(tensions, 1.0, known.states))
    return Held(here, known.touches)
