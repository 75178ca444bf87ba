"""The forward map of a scene with contact: tensions to states on a mesh that moves with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model.arm import Arm
from model.contact.gaps import check_outside, least_gaps
from model.contact.history import History
from model.contact.meshes import mesh_with_contact
from model.contact.newton import newton
from model.contact.path import Followed, by_lengths, close, follow
from model.contact.places import places_of
from model.contact.sharp import Question, Settled, sharpened, with_places
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

# The farthest that frames turn to an equilibrium that counts as nearby [rad].
_NEARBY = 0.6
# From rest meshes that are finer begin with the equilibrium on the coarsest.
_COARSE = 2


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
        self._form = stages, at, machine_code
        self.refinement = refinement
        self._state(System(arm, scene, base, stages, True, machine_code))
        self._fixed = np.unique(landmarks(arm, scene, at))
        self._rest = self.without_loads(np.zeros(arm.n_tendons))
        check_outside(self.system, self._rest)

    def equilibrium(self, tensions: Array, near: Equilibrium | None = None) -> Touching:
        """Return the equilibrium under tensions from rest, or from another; see led."""
        known = near if isinstance(near, Collocated) else None
        before = tensions if near is None else near.tensions
        way = self.led(tensions, before, known)
        return Touching(way.settled.here, self.refinement, way.snaps, way.before)

    def found(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        near = None if known is None else Collocated(known, self.refinement)
        return self.equilibrium(tensions, near).here

    def led(
        self, tensions: Array, before: Array, known: Collocated | None, jumps: bool = True
    ) -> Followed:
        """Return the equilibrium that the arm comes to, and how.

        From rest, or from what is `known`, which is an equilibrium under the tensions `before`.
        With friction it acts against the steps from what is known; an arm without that history has
        none as long as it touches nothing: else InputError. Raises UnsettledContactError where none
        is found, SnapError where it would jump unless it may.
        """
        of, frictional = self._question(tensions), self.system.of.form.contact_friction
        if known is None:
            if frictional:
                return self._untouched(tensions)
            if self.refinement > _COARSE:
                way = self._of(self.system.scene, 1).led(tensions, tensions, None)
                found = sharpened(of, way.settled.here, way.settled.places)
                if found is not None and close(way.settled.here, found.here, _NEARBY):
                    return replace(way, settled=found)
            rest = Linearised(self.system, self.system.x(0 * tensions, 0.0, self._rest))
            return follow(of, 0 * tensions, 0.0, Settled(rest, ()))
        there, places = known.here, places_of(known.system)
        stays = np.array_equal(tensions, before)
        if frictional:
            past = known.history if isinstance(known, Touching) and stays else None
            of = replace(of, history=past or History(there))
        if stays or not frictional:
            found = sharpened(of, there, places)
            if found is not None and close(there, found.here, _NEARBY):
                last = None if of.history is None else of.history.here
                return Followed(found, (), found.here if last is there else last)
        return follow(of, before, 1.0, Settled(there, places), jumps)

    def with_nodes(self, here: Linearised, below: float) -> Linearised:
        """Return an equilibrium on a mesh with nodes where gaps are least, and `below` that.

        Over the arm's length; they tell the gap there. The same equilibrium where none is.
        """
        places = places_of(here.system)
        near = [s for _, s in least_gaps(here.system, here.x, places, below)]
        of = self._question(here.tensions)
        of = replace(of, fixed=np.union1d(self._fixed, near))
        found = with_places(of, here, places) if near else here
        return here if found is None else found

    def by_lengths(self, winches: Winches) -> Linearised | None:
        """Return the equilibrium about where winches hold the tendons; None if none is found."""
        found = by_lengths(self._question(winches.tensions), winches)
        return None if found is None else found.here

    def beside(self, at: Linearised, tensions: Array) -> Linearised | None:
        """Return the equilibrium under tensions near those of another; None where it jumps."""
        try:
            known = Collocated(at, self.refinement)
            return self.led(tensions, at.tensions, known, False).settled.here
        except (SnapError, UnsettledContactError):
            return None

    def _untouched(self, tensions: Array) -> Followed:
        """Return the equilibrium of an arm from rest that touches nothing; InputError else."""
        way = self._smooth.led(tensions, tensions, None)
        here = way.settled.here
        if way.settled.places:
            allowed = (
                "the shape of the same arm that it moved from: friction acts against the motion "
                "before, and an arm without history has none"
            )
            raise InputError("near", None, allowed)
        found = newton(self.system, tensions, 1.0, self.carried(tensions, here))
        if found is None:
            raise UnsettledContactError(1.0, "none is found on a mesh with friction")
        return Followed(Settled(found, ()), way.snaps, found)

    @cached_property
    def _smooth(self) -> TouchingMap:
        """The map of the scene without friction of contacts."""
        return self._of(without_friction(self.system.scene), self.refinement)

    def _of(self, scene: Scene, refinement: int) -> TouchingMap:
        stages, at, machine_code = self._form
        return TouchingMap(self.system.arm, scene, stages, refinement, at, machine_code)

    def _question(self, tensions: Array) -> Question:
        return Question(self.system, self._fixed, tensions)
