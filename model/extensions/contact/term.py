"""The rod term of contact: node variables of all obstacles, their kernels, and pressure."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.kernels import pressure, touch
from octoplan.model.extensions.obstacles.base import distances
from octoplan.model.mesh import Counts, Mesh
from octoplan.model.paths import Array
from octoplan.model.rod.equations import ParameterValues, PlacedKernel
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.rod_term import ElementLoad, RodTerm
from octoplan.model.rod.structure import RodPlaces
from octoplan.model.rotations import POSE
from octoplan.model.support.machine.functions import cached

# Factor of slip in contact friction, over the stiffness E J / L^3 of the base. With the stiffness
# along the arm, E A / L, steps alternated between sticking and slip.
_SLIP_STIFFNESS = 10.0
# Weight of a change of friction as a step of Newton's method: rounding in friction is the rounding
# of forces of the whole arm.
_FRICTION_WEIGHT = 1e-2
# Forces below this are rounding [N].
_FORCE_ROUNDING = 1e-13


class ContactPlaces(NamedTuple):
    """Places of the node variables of K obstacles among the states, or their values.

    Attributes
    ----------
    touches : (N + 1, K, 2)
        The two unknowns of each contact; see octoplan.model.extensions.contact.kernels.
    friction_forces, tractions : (N + 1, K, 3)
        Friction of each contact, and friction per length; (N + 1, 0, 3) if they are no unknowns.
    """

    touches: NDArray[Any]
    friction_forces: NDArray[Any]
    tractions: NDArray[Any]


def split_variables(variables: NDArray[Any], K: int) -> ContactPlaces:
    """Return the parts of node variables (..., n) of K obstacles."""
    shape = variables.shape[:-1]
    touches = variables[..., : 2 * K].reshape(*shape, K, 2)
    rest = variables[..., 2 * K :]
    if rest.shape[-1] == 3 * K:
        return ContactPlaces(
            touches, rest.reshape(*shape, K, 3), rest[..., :0].reshape(*shape, 0, 3)
        )
    both = rest.reshape(*shape, -1, 6)
    return ContactPlaces(touches, both[..., :3], both[..., 3:])


def contact_places(layout: Layout) -> ContactPlaces:
    """Return the places of the node variables of contact."""
    for group, places in zip(layout.node_groups, layout.node_variables, strict=True):
        if isinstance(group.structure.term, ContactTerm):
            return split_variables(places[0], group.structure.term.count)
    raise ValueError("a layout without contact")


@dataclass(frozen=True)
class ContactTerm(RodTerm):
    """Contact of the rod with all obstacles of a scene.

    Attributes
    ----------
    bodies : (K, 17)
        Parameters of the obstacles.
    mu : (K,)
        Coefficients of friction.
    pressed : bool
        Whether the arm may conform to obstacles, so that they press between the nodes too.
    """

    bodies: tuple[tuple[float, ...], ...]
    mu: tuple[float, ...]
    pressed: bool = False
    couples_sections = True
    depends_on_shape = True

    def structure(self) -> Hashable:
        """Return the number of obstacles, and whether there is friction, and pressure."""
        return self.count, self.has_friction, self.pressed

    @property
    def count(self) -> int:
        """The number of obstacles K."""
        return len(self.mu)

    @property
    def has_friction(self) -> bool:
        """Whether an obstacle has friction."""
        return any(self.mu)

    @property
    def n_node_variables(self) -> int:
        """Two variables of each obstacle; with friction three, and three if a part conforms."""
        return (2 + 3 * self.has_friction * (1 + self.pressed)) * self.count

    @property
    def is_nonsmooth(self) -> bool:
        """Whether there is friction: points stick or slip."""
        return self.has_friction

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return all nodes except the base."""
        return tuple(range(1, mesh.elements + 1))

    def convergence_order(self, order: int, derivatives: bool, is_bent: bool) -> int:
        """Return 2 with friction, which acts at nodes if a part conforms to an obstacle."""
        return min(order, 2) if self.has_friction else order

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return no moment: stability in contact is tested with contacts closed."""
        return ()

    def node_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return the contact of the nodes with all obstacles."""
        K = self.count
        law = places.structure.law
        m = places.structure.stages
        N = len(places.nodes) - 1
        touches, _, tractions = split_variables(places.variables, K)
        inside = np.repeat(places.inside.T, K, axis=0)
        poses = np.repeat(places.nodes[1:, :POSE], K, axis=0)
        wrench = np.repeat(places.nodes[1:, POSE : POSE + 6], K, axis=0)
        here = touches[1:].reshape(N * K, -1)
        unknowns = [inside, poses, here]
        rows = [wrench, here]
        if self.has_friction:
            friction = places.variables[1:, 2 * K :].reshape(N * K, -1)
            rows += [friction]
            if self.pressed:
                # No conforming part begins at the tip, so that values beyond it do not matter.
                beyond = [*range(2, N + 1), -2]
                rubbed = np.concatenate([touches[:, :, 1:], tractions], axis=2)
                near = np.concatenate([rubbed[:-1], rubbed[beyond]], axis=2)
                unknowns += [near.reshape(-1, 8)]
            unknowns += [friction]
        kernel = cached(touch, law, m, self.has_friction, self.pressed)
        return [
            PlacedKernel(kernel, places.n_before_states + np.hstack(unknowns).T, np.hstack(rows).T)
        ]

    def element_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return the pressure on the elements."""
        if not self.pressed:
            return []
        K = self.count
        touches, _, tractions = split_variables(places.variables, K)
        inside = np.repeat(places.inside.T, K, axis=0)
        poses = np.repeat(places.nodes[:-1, :POSE], K, axis=0)
        wrench = np.repeat(places.nodes[:-1, POSE : POSE + 6], K, axis=0)
        both = np.stack([touches[:-1, :, 1], touches[1:, :, 1]], axis=2).reshape(-1, 2)
        rubbed = np.concatenate([tractions[:-1], tractions[1:]], axis=2)
        both = np.hstack([both, rubbed.reshape(len(both), -1)])
        unknowns = places.n_before_states + np.hstack([poses, inside, both]).T
        structure = places.structure
        kernel = cached(pressure, structure.law, structure.stages, self.has_friction)
        return [PlacedKernel(kernel, unknowns, np.hstack([wrench, inside]).T)]

    def kernel_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the values of nodes and elements that may touch something; none does yet."""
        h = np.diff(mesh.s)
        bodies = np.tile(np.array(self.bodies).T, h.size)
        nodes = np.repeat([*arm.outer_radius(mesh.s[1:])[:2], h], self.count, axis=1)
        rows: list[Array] = [bodies, nodes, np.zeros((4, bodies.shape[1]))]
        if self.has_friction:
            mu = np.tile(self.mu, h.size)
            r = _SLIP_STIFFNESS * arm.bending_force / arm.length
            rows += [mu, np.full(mu.size, r), np.zeros((3, mu.size))]
        result: ParameterValues = {"touch": {"values": np.vstack(rows)}}
        if self.pressed:
            result["pressure"] = {"values": np.vstack([bodies, nodes[2], 0 * nodes[2]])}
        return result

    def step_sizes(self, steps: Array, states: Array, mesh: Mesh) -> Array:
        """Return the change of friction relative to the largest force (M,)."""
        if not self.has_friction:
            return np.zeros(len(steps))
        change = split_variables(steps, self.count)
        every = (1, 2, 3)
        h = float(np.diff(mesh.s).mean())
        tractions = h * np.abs(change.tractions).max(axis=every, initial=0.0)
        frictions = np.maximum(np.abs(change.friction_forces).max(axis=every), tractions)
        forces = np.abs(split_variables(states, self.count).touches[..., 0]).max(axis=(1, 2))
        return np.asarray(frictions / np.maximum(forces, _FORCE_ROUNDING) * _FRICTION_WEIGHT)

    def element_load(
        self, variables: Array, parameters: ParameterValues, elements: Counts, share: Array
    ) -> ElementLoad | None:
        """Return pressure and traction of obstacles, linear between nodes of conforming parts."""
        if not self.pressed:
            return None
        K = self.count
        x = share[:, :, :, None, None]
        flags = parameters["pressure"]["values"][-1]
        lies = flags.reshape(-1, K, 1)[elements]

        def linear(values: Array) -> Array:
            return np.asarray(lies * ((1 - x) * values[elements] + x * values[elements + 1]))

        touches, _, tractions = split_variables(variables, K)
        pressures = linear(touches[:, :, 1:])[..., 0]
        rubs = np.zeros((*share.shape, 3))
        if self.has_friction:
            rubs += linear(tractions).sum(axis=3)
        bodies = np.array(self.bodies)

        def load(at: tuple[int, int], positions: Array) -> tuple[Array, Array]:
            normals = distances(bodies, positions)[1]
            return np.einsum("nk,nki->ni", pressures[at], normals), rubs[at]

        return load
