"""How an equilibrium answers to forces on its midline, to its tendons, and to its own numbers.

By the implicit function theorem through the equations of equilibrium g(x, p) = 0: one
factorisation, and a right-hand side for each component of a force and a moment, for each tension,
and for each number theta of arm and scene, dx = - (dg/dx)^-1 dg/dp dp/dtheta.

The numbers p are cheap to put together, nothing is settled for them, and they are smooth in theta:
differences of arms and scenes a little to both sides are good to nine digits or more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from octoplan.model.cross_section.sections import kinematics
from octoplan.model.equilibrium.integration import poses_and_strains
from octoplan.model.equilibrium.linearised import Equilibrium, Index
from octoplan.model.equilibrium.stability import is_stable, rotation_basis
from octoplan.model.paths import Array
from octoplan.model.rotations import matrices


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """The derivatives of an equilibrium's pose at a node and of its tendons' lengths.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    node : int
        The node that is pushed and watched.
    """

    point: Equilibrium
    node: int

    @cached_property
    def _by_wrench(self) -> Array:
        return -self.point.solve(self.point.system.by_wrench(self.point.x, self.node))

    @property
    def pose_wrench(self) -> Array:
        """Displacement [m] and rotation [rad] per force [N] and moment [N m] (6, 6), base frame."""
        return self._pose(self._by_wrench)

    @property
    def pose_tension(self) -> Array:
        """The same per newton in each tendon at its motor (6, n_tendons)."""
        return self._pose(self.point.by_tensions)

    @property
    def lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""
        return self.point.lengths

    @property
    def length_wrench(self) -> Array:
        """Lengths of the tendons per force and moment (n_tendons, 6)."""
        return np.asarray(self.point.system.length_jacobian(self.point.x) @ self._by_wrench)

    @property
    def length_tension(self) -> Array:
        """Lengths of the tendons per newton (n_tendons, n_tendons) [m/N]."""
        return self.point.length_tension

    @property
    def stable(self) -> bool:
        """Whether the equilibrium stands, tensions held."""
        return is_stable(self.point)

    def _pose(self, change: Array) -> Array:
        """Return displacement and rotation (6, n) of the node that changes of the states are."""
        of = self.point.system.layout
        places = of.nodes[self.node]
        q = self.point.states[places[:4]]
        return np.vstack(
            [change[places[4:7]], 4 * rotation_basis(q[None, :])[0].T @ change[places[:4]]]
        )


@dataclass(frozen=True, eq=False)
class ParameterSensitivities:
    """The derivatives of an equilibrium by K numbers of arm and scene.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    numbers, length_numbers : (n_p, K), (n, K)
        Of the numbers of its equations, and of those of the tendons' lengths.
    tensions : (n_tendons, K)
        Of its tensions [N].
    """

    point: Equilibrium
    numbers: Array
    length_numbers: Array
    tensions: Array

    @cached_property
    def states(self) -> Array:
        """Of the states (n_states, K)."""
        at = self.point.system
        right = at.layout.equations.along_parameters(self.point.x, at.p, self.numbers)
        result = -self.point.solve(np.asfortranarray(right))
        return result + self.point.by_tensions @ self.tensions if self.tensions.any() else result

    @property
    def lengths(self) -> Array:
        """Of the lengths of the tendons (n_tendons, K) [m]."""
        at, x = self.point.system, self.point.x
        direct = at.layout.lengths.along_parameters(x, at.length_p, self.length_numbers)
        return np.asarray(at.length_jacobian(x) @ self.states + direct)


def along(point: Equilibrium, nodes: Index) -> Array:
    """Return how poses change along the arm at nodes (n, 7), per m of arc length."""
    system = point.system
    poses, v = poses_and_strains(system, point.x, system.mesh.s[nodes])
    kappa, nu = kinematics(system.layout.structure.law, v)
    local = np.stack([kappa, nu], axis=2)
    turned, moved = np.moveaxis(matrices(poses[:, :4]) @ local, 2, 0)
    return np.hstack([(rotation_basis(poses[:, :4]) @ turned[:, :, None])[:, :, 0], moved])
