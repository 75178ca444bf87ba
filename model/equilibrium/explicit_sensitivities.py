"""Sensitivities of the closed form to tensions and wrenches, from the twists of its steps.

A change of a step exp(Omega) moves the arm beyond the step by a spatial twist z = (rotation,
shift), and a node by the sum of the twists of all steps before the node. With the derivatives Z of
z by kappa and nu at the nodes of a step, and the quadrature weights W of these nodes,

    z = sum of Z twist' dv,      K dv = Z^T w / W - (wrench per newton) dT.

Here twist' is the derivative of kappa and nu by the strains v, K the derivative of the wrench of
the cross-section, and w a moment and a force at the node. The first equation is the chain rule, the
second the principle of virtual work with the same Z. Sensitivities by collocation take 1.1 to 4.4
times as long (octoplan.model.equilibrium.sensitivities). Sources: see
octoplan.model.rod.collocation.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, components, size
from octoplan.model.cross_section.sections import strains_of
from octoplan.model.equilibrium.explicit import ClosedForm, ExplicitEquilibrium
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import Magnus
from octoplan.model.rotations import conjugate, exponential, matrix, multiply
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import BufferedFunction, cached

_ROUNDING = 4 * np.finfo(float).eps


class ExplicitSensitivities:
    """Sensitivities of an equilibrium in closed form.

    The interface is that of octoplan.model.equilibrium.sensitivities.Sensitivities for arms under
    loads.

    Parameters
    ----------
    point : ExplicitEquilibrium
        The equilibrium.
    node : int
        The node at which wrenches act and displacements are evaluated.
    """

    def __init__(self, point: ExplicitEquilibrium, node: int) -> None:
        forward = point.forward
        assert isinstance(forward, ClosedForm)
        self._at = at = forward.sections
        h = np.diff(forward.mesh.s)
        law = at.law
        place = point.poses[node, 4:]
        _, self._weights, _ = forward.mesh.points(len(forward.scheme.nodes))
        self._v = v = strains_of(law, point.strains[: at.s.size])
        self._balance = at.balance(v, point.tensions[at.tendon])
        call = cached(_step_twists, law, forward.scheme, h.size, forward.machine_code)
        # Z transposed (P, 6 of kappa and nu, 6 of z) and Z twist' (P n, 6), 0 beyond the node.
        twists, by_strains = call(point.poses[:-1].ravel(), v.ravel(), h)
        twists = twists.reshape(-1, 6, 6)
        by_strains = by_strains.reshape(*v.shape, 6)
        beyond = node * len(forward.scheme.nodes)
        twists[beyond:] = 0.0
        by_strains[beyond:] = 0.0
        # The map from force and moment at the node to moment and force about the base.
        unit = np.eye(3)
        about_base = np.block([[np.cross(unit, place), unit], [unit, 0 * unit]])
        self._pose = about_base.T @ by_strains.reshape(-1, 6).T
        local = twists @ about_base / self._weights[:, None, None]
        self._wrench = local[:, components(law)]

    @property
    def pose_tension(self) -> Array:
        """Displacement [m] and rotation [rad] per newton in each tendon (6, n_tendons)."""
        return np.asarray(self._pose @ self._by_tensions)

    @cached_property
    def pose_wrench(self) -> Array:
        """Displacement [m] and rotation [rad] per force [N] and moment [N m] (6, 6), base frame."""
        return np.asarray(self._pose @ self._by_wrench)

    @property
    def lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""
        return self._at.lengths(self._v, self._weights)[0]

    @property
    def length_wrench(self) -> Array:
        """Lengths of the tendons per force and moment (n_tendons, 6)."""
        return np.asarray(self._length_jacobian @ self._by_wrench)

    @property
    def length_tension(self) -> Array:
        """Lengths of the tendons per newton (n_tendons, n_tendons) [m/N]."""
        return np.asarray(self._length_jacobian @ self._by_tensions)

    @property
    def stable(self) -> bool:
        """Whether each cross-section is at a minimum of its energy, tensions held."""
        K = self._balance.jacobian
        values = np.linalg.eigvalsh((K + K.transpose(0, 2, 1)) / 2)
        # A tendon without length is stiffer than the rest of the section by more than rounding.
        return bool(np.all(values[:, 0] > -_ROUNDING * values[:, -1]))

    @property
    def _by_tensions(self) -> Array:
        """The derivatives of the strains by the tensions (P n, n_tendons)."""
        by_tensions = self._at.by_tensions(self._balance)
        return by_tensions.reshape(-1, by_tensions.shape[-1])

    @property
    def _by_wrench(self) -> Array:
        """The derivatives of the strains by a force and moment at the node (P n, 6)."""
        return np.linalg.solve(self._balance.jacobian, self._wrench).reshape(-1, 6)

    @property
    def _length_jacobian(self) -> Array:
        """The derivatives of the lengths by the strains (n_tendons, P n)."""
        jacobian = self._at.lengths(self._v, self._weights)[1]
        return jacobian.reshape(len(jacobian), -1)


def _step_twists(
    law: CrossSection, scheme: Magnus, steps: int, machine_code: bool
) -> BufferedFunction:
    """Return (pose before a step, strains at the nodes, h) -> Z and Z twist'; see the module."""
    m = len(scheme.nodes)
    g = ca.SX.sym("g", 7)
    v = ca.SX.sym("v", size(law), m)
    h = ca.SX.sym("h")
    e = ca.SX.sym("e", 6 * m)
    sections = ca.horzsplit(v)
    twists = ca.vertcat(*(part for one in sections for part in law.twist(one)))
    _, local = step_jacobian(scheme, ca.vertsplit(e, 6), h, e)
    seen = adjoint_function()(g) @ ca.substitute(local, e, twists)
    results = [ca.densify(seen), ca.densify(seen @ ca.jacobian(twists, ca.vec(v)))]
    function = ca.Function("twists", [g, ca.vec(v), h], results, {"cse": True})
    return BufferedFunction(kernel(function, machine_code).map(steps))


def step_jacobian(scheme: Magnus, twists: list[ca.SX], h: ca.SX, e: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pose (7,) of a step, and the derivatives (6, n) of z by e (n,).

    `twists` (6,) at the nodes of the scheme are expressions of e.
    """
    omega = scheme.expansion(twists, h)
    pose, jacobian = _exponential_jacobian()(omega)
    return pose, ca.densify(jacobian @ ca.jacobian(omega, e))


def _exponential_jacobian() -> ca.Function:
    """Return Omega (6,) -> exp(Omega) (7,), derivatives of z by Omega (6, 6)."""
    omega = ca.SX.sym("omega", 6)
    pose = exponential(omega[:3], omega[3:])
    columns = []
    for change in ca.horzsplit(ca.jacobian(pose, omega)):
        rotation = 2 * multiply(change[:4], conjugate(pose[:4]))[1:]
        columns.append(ca.vertcat(rotation, change[4:] - ca.cross(rotation, pose[4:])))
    return ca.Function("jacobian", [omega], [pose, ca.horzcat(*columns)], {"cse": True})


def adjoint_function() -> ca.Function:
    """Return pose -> (6, 6), the map of local twists to spatial ones."""
    g = ca.SX.sym("g", 7)
    R = matrix(g[:4])
    return ca.Function(
        "adjoint", [g], [ca.densify(ca.blockcat([[R, ca.SX(3, 3)], [ca.skew(g[4:]) @ R, R]]))]
    )
