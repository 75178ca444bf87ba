"""How a march answers to its strains, and so to tensions and wrenches: by twists of its steps.

A step is exp(Omega). A change of it moves all that is beyond by a spatial twist z = (rotation,
shift), so that a place on the arm moves by the sum of the steps before it. With Z the derivatives
of z by kappa and nu at a step's nodes, and W the nodes' weights in an integral along the arm,

    z = sum of Z twist' dv,      K dv = Z^T w / W - (wrench per newton) dT,

where twist' are those of kappa and nu by the strains v, and K of the cross-section's wrench. The
first is the chain rule, the second the principle of virtual work with the same Z: w is a moment
and a force at the place. Sources: see octoplan.model.integrators.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, components, size
from octoplan.model.cross_section.sections import strains_of
from octoplan.model.integrators import Magnus
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, exponential, matrix, multiply
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import BufferedFunction, cached
from octoplan.model.unloaded.closed_form import ClosedForm
from octoplan.model.unloaded.marched import Marched

_ROUNDING = 4 * np.finfo(float).eps


class MarchDerivative:
    """See octoplan.model.equilibrium.sensitivities.Sensitivities, which has the same for arms with
    loads.

    Parameters
    ----------
    point : Marched
        The equilibrium, in closed form.
    node : int
        The node of its mesh that is pushed and watched.
    """

    def __init__(self, point: Marched, node: int) -> None:
        march = point.march
        assert isinstance(march, ClosedForm)
        self._at = at = march.sections
        h, law = np.diff(march.mesh.s), at.law
        self._weights, place = march.mesh.points(len(march.scheme.nodes))[1], point.poses[node, 4:]
        self._v = v = strains_of(law, point.strains[: at.s.size])
        self._balance = at.balance(v, point.tensions[at.tendon])
        call = cached(_step_twists, law, march.scheme, h.size, march.machine_code)
        # Z transposed (P, 6 of kappa and nu, 6 of z) and Z twist' (P n, 6), 0 beyond the node.
        twists, by_strains = call(point.poses[:-1].ravel(), v.ravel(), h)
        twists, by_strains = twists.reshape(-1, 6, 6), by_strains.reshape(*v.shape, 6)
        beyond = node * len(march.scheme.nodes)
        twists[beyond:], by_strains[beyond:] = 0.0, 0.0
        # Displacement and rotation of the place, and the same as moment and force about the base.
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
        """The same per force [N] and moment [N m] at the node (6, 6), base frame."""
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
        # Where a tendon has no length left it is stiff beyond all digits of the rest.
        return bool(np.all(values[:, 0] > -_ROUNDING * values[:, -1]))

    @property
    def _by_tensions(self) -> Array:
        """How strains change with the tensions (P n, n_tendons)."""
        by_tensions = self._at.by_tensions(self._balance)
        return by_tensions.reshape(-1, by_tensions.shape[-1])

    @property
    def _by_wrench(self) -> Array:
        """How strains change with a force and moment at the node (P n, 6)."""
        return np.linalg.solve(self._balance.jacobian, self._wrench).reshape(-1, 6)

    @property
    def _length_jacobian(self) -> Array:
        """How lengths change with the strains (n_tendons, P n)."""
        jacobian = self._at.lengths(self._v, self._weights)[1]
        return jacobian.reshape(len(jacobian), -1)


def _step_twists(
    law: CrossSection, scheme: Magnus, steps: int, machine_code: bool
) -> BufferedFunction:
    """Return (pose before a step, strains at its nodes, h) -> Z and Z twist' of the module."""
    m = len(scheme.nodes)
    g, v, h = ca.SX.sym("g", 7), ca.SX.sym("v", size(law), m), ca.SX.sym("h")
    e, sections = ca.SX.sym("e", 6 * m), ca.horzsplit(v)
    twists = ca.vertcat(*(part for one in sections for part in law.twist(one)))
    _, local = step_jacobian(scheme, ca.vertsplit(e, 6), h, e)
    seen = adjoint_function()(g) @ ca.substitute(local, e, twists)
    results = [ca.densify(seen), ca.densify(seen @ ca.jacobian(twists, ca.vec(v)))]
    function = ca.Function("twists", [g, ca.vec(v), h], results, {"cse": True})
    return BufferedFunction(kernel(function, machine_code).map(steps))


def step_jacobian(scheme: Magnus, twists: list[ca.SX], h: ca.SX, e: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pose (7,) of a step, and the derivatives (6, n) of its z against e (n,).

    `twists` (6,) at the scheme's nodes are expressions of e.
    """
    omega = scheme.expansion(twists, h)
    pose, jacobian = _exponential_jacobian()(omega)
    return pose, ca.densify(jacobian @ ca.jacobian(omega, e))


def _exponential_jacobian() -> ca.Function:
    """Return Omega (6,) -> exp(Omega) (7,), derivatives of z against Omega (6, 6)."""
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
