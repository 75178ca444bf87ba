"""The forward map of a scene with contact, from tensions to states on a moving mesh."""

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
from octoplan.model.loads import growth_rate, is_coupled, required_arc_lengths
from octoplan.model.mesh import Mesh, graded, landmarks
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError, SnapError, UnsettledContactError
from octoplan.model.support.progress import PATIENCE

# Number of elements relative to a mesh without contact; largest element length relative to the arm
# and relative to the size of obstacle and arm; lower limit of this size relative to the arm.
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
        # Landmarks that nearly coincide share a node.
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
        """Return the equilibrium that the arm reaches from another equilibrium or from rest.

        From rest the loads act first, then the tensions, as on arms without contact. Friction
        opposes the steps from `near`; for equal tensions the steps of the path of `near` are
        repeated on this mesh. Raises InputError for an arm in contact with friction without `near`,
        UnsettledContactError if no equilibrium is found, and SnapError if the arm snaps and `jumps`
        is False.
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
        """Return the equilibrium that an arm reaches from rest; raises UnsettledContactError.

        The loads act first, then the tensions. An arm that snaps under the loads alone is pulled
        first, unless the arm snaps in this order, too.
        """
        if not is_coupled(self.system.arm, self.system.scene):
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
        """The equilibrium under the loads alone; None if the arm snaps."""
        alone = Request(self.system, self._fixed, np.zeros(self.system.layout.n_tendons))
        with suppress(SnapError, UnsettledContactError):
            return follow(alone, self._at_rest, jumps=False)
        return None

    def solve_from(self, at: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium after load steps from another one; None if the arm jumps."""
        with suppress(SnapError, UnsettledContactError):
            return self.solve(tensions, at, jumps=False)
        return None

    def beside(self, at: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under similar tensions near another one, or None.

        Contact places move, begin and end from the places of the other equilibrium.
        """
        return sharpened(Request(self.system, self._fixed, tensions), at)

    def with_places(self, at: Equilibrium, places: Places) -> Equilibrium | None:
        """Return the equilibrium with given contact places near another one, for equal tensions.

        None if Newton's method does not converge.
        """
        return at_places(Request(self.system, self._fixed, at.tensions), at, places)

    def _contact_free(self, tensions: Array) -> ContactEquilibrium:
        """Return the equilibrium without friction; raises InputError if the arm is in contact."""
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
        """The map of the scene without friction of contacts."""
        if not self._rubs:
            return self
        arm, smooth = self.system.arm, without_friction(self.system.scene)
        return TouchingMap(arm, smooth, *self._mesh_options)


def mesh_with_contact(arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...]) -> Mesh:
    """Return the mesh of a refinement that has the arc lengths `at` as nodes."""
    bodies = bodies_of(scene)
    small = float((bodies[:, 15] + bodies[:, 12:15].min(axis=1)).min())

    def density(s: Array) -> Array:
        """Return the growth rate of solutions, or of changes of contact, at s (N,) [1/m]."""
        wide = np.maximum(small + arm.outer_radius(s)[0], _SHORTEST * arm.length)
        return np.maximum(
            growth_rate(arm, scene, s), 0.75 / np.minimum(wide, _LONGEST * arm.length)
        )

    return graded(arm, _FINER * refinement, (*at, *required_arc_lengths(arm, scene)), density)
