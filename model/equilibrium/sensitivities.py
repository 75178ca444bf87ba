"""Sensitivities of an equilibrium to forces on the midline, to tensions and to parameters.

The implicit function theorem, applied to the equilibrium g(x, p) = 0, needs one factorisation and a
right-hand side for each component of a force and a moment, for each tension, and for each parameter
theta of arm and scene: dx = - (dg/dx)^-1 dg/dp dp/dtheta.

dp/dtheta is a central difference. The parameters p are smooth in theta and need no equilibrium, so
that the difference has nine digits or more.
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
    """Derivatives of the pose of a node and of the lengths of the tendons.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    node : int
        The node at which the wrench acts and the pose is measured.
    """

    point: Equilibrium
    node: int

    @cached_property
    def _by_wrench(self) -> Array:
        """The derivatives of the states (n_states, 6) by force and moment."""
        return -self.point.solve(self.point.system.by_wrench(self.point.x, self.node))

    @property
    def pose_wrench(self) -> Array:
        """Displacement [m] and rotation [rad] per force [N] and moment [N m] (6, 6), base frame."""
        return self._pose(self._by_wrench)

    @property
    def pose_tension(self) -> Array:
        """Displacement and rotation (6, n_tendons) per newton in each tendon at its motor."""
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
        """Whether the equilibrium is stable at constant tensions."""
        return is_stable(self.point)

    def _pose(self, change: Array) -> Array:
        """Return displacement and rotation (6, n) of the node for changes of the states."""
        places = self.point.system.layout.nodes[self.node]
        q = self.point.states[places[:4]]
        rotation = 4 * rotation_basis(q[None, :])[0].T @ change[places[:4]]
        return np.vstack([change[places[4:7]], rotation])


@dataclass(frozen=True, eq=False)
class ParameterSensitivities:
    """Derivatives of an equilibrium by K parameters theta of arm and scene.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    parameters : (n_p, K)
        Derivatives of the parameters p of the equations.
    length_parameters : (n, K)
        Derivatives of the parameters of the tendon lengths.
    tensions : (n_tendons, K)
        Derivatives of the tensions [N].
    """

    point: Equilibrium
    parameters: Array
    length_parameters: Array
    tensions: Array

    @cached_property
    def states(self) -> Array:
        """Derivatives of the states (n_states, K)."""
        system = self.point.system
        equations = system.layout.equations
        right = equations.along_parameters(self.point.x, system.p, self.parameters)
        result = -self.point.solve(np.asfortranarray(right))
        return result + self.point.by_tensions @ self.tensions if self.tensions.any() else result

    @property
    def lengths(self) -> Array:
        """Derivatives of the lengths of the tendons (n_tendons, K) [m]."""
        system = self.point.system
        x = self.point.x
        lengths = system.layout.lengths
        direct = lengths.along_parameters(x, system.length_p, self.length_parameters)
        return np.asarray(system.length_jacobian(x) @ self.states + direct)


def along(point: Equilibrium, nodes: Index) -> Array:
    """Return the derivatives of the poses by arc length at nodes (n, 7) [1/m]."""
    system = point.system
    poses, v = poses_and_strains(system, point.x, system.mesh.s[nodes])
    kappa, nu = kinematics(system.layout.structure.law, v)
    local = np.stack([kappa, nu], axis=2)
    turned, moved = np.moveaxis(matrices(poses[:, :4]) @ local, 2, 0)
    return np.hstack([(rotation_basis(poses[:, :4]) @ turned[:, :, None])[:, :, 0], moved])
