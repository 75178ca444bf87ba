"""The forward map of a scene with contact: tensions to states on a mesh that moves with them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, History
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.extensions.contact.effects import bodies_of, contacts, without_friction
from octoplan.model.extensions.contact.gaps import check_outside
from octoplan.model.extensions.contact.path import ContactEquilibrium, follow, retraced
from octoplan.model.extensions.contact.sharp import Request, at_places, sharpened
from octoplan.model.extensions.contact.touches import Places, places_of
from octoplan.model.loads import growth_rate, is_loaded, required_arc_lengths
from octoplan.model.mesh import Mesh, graded, landmarks
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError, SnapError, UnsettledContactError
from octoplan.model.support.progress import PATIENCE

# Elements of a mesh over those of one without contact, and how long the longest may be: a part of
# the arm's length, or of obstacle and arm together, but no shorter than a part of the length.
_FINER, _LONGEST, _SHORTEST = 2, 1 / 16, 1 / 100


class TouchingMap(CollocationMap):
    """The equations of an arm that may touch obstacles, on a mesh that moves with the contacts."""

    patience = PATIENCE

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        base = mesh_with_contact(arm, scene, refinement, at)
        self._mesh_options = refinement, at, machine_code
        super().__init__(DiscreteRod(arm, scene, base, STAGES, True, machine_code))
        self._rubs = any(contact.friction for contact in contacts(scene))
        # Landmarks may be so near to each other that they are one node.
        self._fixed = base.s[
            sorted({base.node(s) for s in landmarks(arm, (*required_arc_lengths(arm, scene), *at))})
        ]
        none = np.zeros(arm.n_tendons)
        x = self.system.x(none, 0.0, self.without_loads(none))
        self._at_rest = Equilibrium(self.system, x)
        check_outside(self.system, self._at_rest.states)

    def solve(
        self,
        tensions: Array,
        near: AnyEquilibrium | None = None,
        tolerance_factor: float = 1.0,
        jumps: bool = True,
    ) -> ContactEquilibrium:
        """Return the equilibrium that the arm comes to from another one or from rest.

        From rest the loads act first, then the tensions, as on arms that touch nothing. Friction
        acts against the steps from there, which are those on another mesh where tensions are the
        same; an arm without that history has an equilibrium as long as it touches nothing: else
        InputError. Raises UnsettledContactError where none is found, SnapError where it would jump
        unless it may.
        """
        end = Request(self.system, self._fixed, tensions)
        if not isinstance(near, Equilibrium):
            if self._rubs:
                free = self._contact_free(tensions)
                return replace(self.solve(tensions, free), snaps=free.snaps, history=free.history)
            return self._loaded_then_pulled(end)
        stays = np.array_equal(tensions, near.tensions)
        history: History = near.history if stays else "near"
        if self._rubs:
            past = near.path if stays and isinstance(near, ContactEquilibrium) else ()
            path = past or ((near, 0.0), (near, 1.0))
            begin = path[0][0]
            end = replace(end, before=begin)
            again = retraced(end, path) if stays else None
            return replace(again or follow(end, begin, jumps), history=history)
        there = sharpened(end, near)
        found = follow(end, near, jumps) if there is None else ContactEquilibrium.of(there)
        return replace(found, history=history)

    def _loaded_then_pulled(self, end: Request) -> ContactEquilibrium:
        """Return the equilibrium that an arm at rest comes to; raises UnsettledContactError.

        The loads act first, then the tensions. An arm that snaps under its loads alone is pulled
        first, unless it snaps then as well.
        """
        if not is_loaded(self.system.arm, self.system.scene):
            return replace(follow(end, self._at_rest), history="loads first")
        if self._hanging is not None:
            return replace(follow(end, self._hanging), history="loads first")
        with suppress(SnapError, UnsettledContactError):
            pulled = follow(replace(end, load=0.0), self._at_rest, jumps=False)
            return replace(follow(end, pulled), history="tensions first")
        loaded = follow(replace(end, tensions=0.0 * end.tensions), self._at_rest)
        there = follow(end, loaded)
        return replace(there, snaps=loaded.snaps + there.snaps, history="loads first")

    @cached_property
    def _hanging(self) -> ContactEquilibrium | None:
        """The equilibrium under the loads alone; None if the arm snaps on its way there."""
        alone = Request(self.system, self._fixed, np.zeros(self.system.layout.n_tendons))
        with suppress(SnapError, UnsettledContactError):
            return follow(alone, self._at_rest, jumps=False)
        return None

    def solve_from(self, at: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium that another leads to, by load steps; None where it jumps."""
        with suppress(SnapError, UnsettledContactError):
            return self.solve(tensions, at, jumps=False)
        return None

    def beside(self, at: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions near those of another; None where it is not near.

        Places move on, come and go from those of the other.
        """
        return sharpened(Request(self.system, self._fixed, tensions), at)

    def with_places(self, at: Equilibrium, places: Places) -> Equilibrium | None:
        """Return the equilibrium that touches at given places near another, for equal tensions.

        None if Newton's method does not converge.
        """
        return at_places(Request(self.system, self._fixed, at.tensions), at, places)

    def _contact_free(self, tensions: Array) -> ContactEquilibrium:
        """Return the equilibrium of an arm without friction that touches nothing; or InputError."""
        free = self.without_friction.solve(tensions)
        if places_of(free.system):
            allowed = (
                "the shape of the same arm that it moved from: friction acts against the motion "
                "before, and an arm without history has none"
            )
            raise InputError("near", None, allowed)
        return free

    @cached_property
    def without_friction(self) -> TouchingMap:
        """The map of the scene without friction of contacts; itself where there is none."""
        if not self._rubs:
            return self
        arm, smooth = self.system.arm, without_friction(self.system.scene)
        return TouchingMap(arm, smooth, *self._mesh_options)


def mesh_with_contact(arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...]) -> Mesh:
    """Return the mesh of a refinement that has the arc lengths `at` as nodes."""
    bodies = bodies_of(scene)
    small = float((bodies[:, 15] + bodies[:, 12:15].min(axis=1)).min())

    def density(s: Array) -> Array:
        """Return how fast solutions may grow, or contact may change, at s (N,) [1/m]."""
        wide = np.maximum(small + arm.outer_radius(s)[0], _SHORTEST * arm.length)
        return np.maximum(
            growth_rate(arm, scene, s), 0.75 / np.minimum(wide, _LONGEST * arm.length)
        )

    return graded(arm, _FINER * refinement, (*at, *required_arc_lengths(arm, scene)), density)
