"""Explicit forward maps of arms with independent cross-sections, and their equilibria.

Tendon lengths under tensions are quadratures of the strains of the cross-sections. Their
derivatives follow from the implicit function theorem for the balance of each cross-section.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Extremes, Sections
from octoplan.model.integrators import Magnus, RungeKutta
from octoplan.model.mesh import Mesh, graded
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.errors import CollapsedError
from octoplan.model.support.machine.functions import cached

# Gauss points per element of the coarsest mesh in tendon lengths. Strains are analytic between
# nodes, so that only rounding remains, also at three times the tensions of the paper's arms.
LENGTH_POINTS = 8


@dataclass(frozen=True, eq=False)
class Lengths:
    """Tendon lengths under tensions.

    Attributes
    ----------
    at : Sections
        The cross-sections at the points of the quadrature.
    tensions : (n_tendons,)
        [N].
    strains : (N, n)
        Strains of the cross-sections.
    lengths : (n_tendons,)
        [m].
    jacobian : (n_tendons, N, n)
        Derivatives of the lengths by the strains.
    """

    at: Sections
    tensions: Array
    strains: Array
    lengths: Array
    jacobian: Array

    @classmethod
    def under(cls, at: Sections, weights: Array, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,), with weights (N,) of cross-sections."""
        v = at.strains(tensions)
        return cls(at, tensions, v, *at.lengths(v, weights))

    @property
    def crushed(self) -> CollapsedError | None:
        """The error of the first cross-section in which a tendon has no length, if any."""
        return self.at.crushed(self.strains)

    @cached_property
    def length_tension(self) -> Array:
        """The derivatives of the lengths by the tensions (n_tendons, n_tendons) [m/N]."""
        at = self.at
        balance = at.balance(self.strains, self.tensions[at.tendon])
        return np.tensordot(self.jacobian, at.by_tensions(balance), 2)


@lru_cache(maxsize=48)
def tendon_lengths(
    arm: Arm, scene: Scene, machine_code: bool = False
) -> Callable[[Array], Lengths]:
    """Return the function tensions (n_tendons,) -> Lengths, by Gauss quadrature, without loads.

    The function raises UnsettledSectionError.
    """
    law = cross_section_of(scene, arm.is_curved, twisted=False)
    s, weights, active = graded(arm, 1).points(LENGTH_POINTS)
    return partial(Lengths.under, Sections(arm, scene, law, s, active, machine_code), weights)


class ExplicitMap(ABC):
    """The forward map of an arm with independent cross-sections on a mesh.

    Attributes
    ----------
    scheme : Magnus or RungeKutta
        The integrator of the poses, or of poses and strains.
    refinement : int
        The refinement of the mesh.
    stretch_at : (K,)
        Arc lengths at which strains are reported [m].
    radius : (K,)
        Radius of the body there [m].
    """

    # Error of the tip by rounding, over the arm's length.
    rounding: ClassVar[float] = 1e-14
    # Processor time that the equilibrium on a mesh may take [s].
    patience: ClassVar[float] = math.inf
    # Whether a cross-section without an equilibrium has none on a finer mesh either.
    sections_are_exact: ClassVar[bool] = True

    arm: Arm
    scene: Scene
    scheme: Magnus | RungeKutta
    refinement: int
    machine_code: bool
    mesh: Mesh
    stretch_at: Array
    radius: Array

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = self.arm, self.scene, self.scheme, self.refinement, (), self.machine_code
        return cached, (type(self), *arguments)

    @property
    @abstractmethod
    def function(self) -> ca.Function:
        """Tensions (n_tendons,) -> poses (7, S + 1), 1 + q at `stretch_at` (1, K), for CasADi."""

    @abstractmethod
    def run(self, tensions: Array) -> tuple[Array, Array]:
        """Return poses (S + 1, 7) at the nodes, and tau, xi, k, q (K, 4) at `stretch_at`."""

    @abstractmethod
    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at s (N,) [m], from the results of `run`."""

    def many(self, tensions: Array, nodes: Sequence[int] | None = None) -> tuple[Array, Array]:
        """Return poses (M, nodes, 7) under tensions (M, n_tendons), and the least 1 + q (M,).

        The default of `nodes` is the last node.
        """
        nodes = [-1] if nodes is None else nodes
        values = [self.run(T) for T in tensions]
        poses = np.array([rows[nodes] for rows, _ in values]).reshape(-1, len(nodes), 7)
        return poses, np.array([1 + strains[:, 3].min() for _, strains in values])

    def solve(self, tensions: Array, near: object = None, tolerance_factor: float = 1.0) -> Marched:
        """Return the equilibrium under tensions (n_tendons,); other arguments have no effect."""
        return Marched(self, tensions, *self.run(tensions))

    def tendon_lengths(self, point: Marched) -> Array:
        """Return the lengths of the tendons (n_tendons,) in an equilibrium of this map [m]."""
        return point.tendons.lengths


@dataclass(frozen=True, eq=False)
class Marched:
    """An equilibrium of an arm with independent cross-sections.

    The interface is that of octoplan.model.equilibrium.linearised.Equilibrium.

    Attributes
    ----------
    march : ExplicitMap
        The forward map.
    tensions : (n_tendons,)
        [N].
    poses : (N + 1, 7)
        Quaternions and positions [m] at the nodes.
    strains : (K, 4)
        tau, xi, k, q at the `stretch_at` of the map.
    """

    march: ExplicitMap
    tensions: Array
    poses: Array
    strains: Array

    @property
    def mesh(self) -> Mesh:
        """See Equilibrium."""
        return self.march.mesh

    @property
    def snaps(self) -> tuple[float, ...]:
        """See Equilibrium."""
        return ()

    @property
    def jump(self) -> float | None:
        """See Equilibrium: not searched without loads."""
        return None

    @property
    def scheme(self) -> str:
        """See Equilibrium."""
        return self.march.scheme.name

    @cached_property
    def extremes(self) -> Extremes:
        """See Equilibrium."""
        _, xi, k, q = self.strains.T
        return Extremes.of(self.march.stretch_at, q, np.hypot(xi, k), self.march.radius)

    @property
    def machine_code(self) -> bool:
        """See Equilibrium."""
        return self.march.machine_code

    def at(self, s: Array) -> tuple[Array, Array]:
        """See Equilibrium: one step of the integrator from the node next to s."""
        return self.march.dense(self.tensions, self.poses, self.strains, s)

    @cached_property
    def tendons(self) -> Lengths:
        """The tendons under the tensions, with closed-form strains."""
        march = self.march
        return tendon_lengths(march.arm, march.scene, march.machine_code)(self.tensions)

    @property
    def length_tension(self) -> Array:
        """See Equilibrium. Undefined for the equations as printed."""
        return self.tendons.length_tension

    @cached_property
    def lengths(self) -> Array:
        """See Equilibrium: the integral of ``|du_c/ds|`` by Gauss quadrature."""
        return self.march.tendon_lengths(self)
