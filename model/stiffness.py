"""Stiffness of a settled arm: responses to forces, moments and tensions, and the tip Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.compliance import (
    Response,
    by_lengths,
    compliance_of,
    section_stiffness,
    sensitivities,
)
from octoplan.model.equilibrium.explicit import ClosedForm, ExplicitEquilibrium, ExplicitMap
from octoplan.model.equilibrium.explicit_sensitivities import ExplicitSensitivities
from octoplan.model.forward import explicit_map
from octoplan.model.loads import check_responses, is_coupled
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, multiply
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, checked_scene, settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import arc_lengths, flag, literal, within
from octoplan.model.support.errors import InputError, SingularError
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import limited
from octoplan.model.support.text import HtmlRepr, columns, plotted, tendon_table
from octoplan.model.tendons import checked_EA, is_taut

Hold = Literal["tension", "length"]
# Smallest relative singular value of the lengths by the tensions that counts as determined.
_RANK_TOL = 1e-9


@dataclass(frozen=True, eq=False)
class Stiffness(HtmlRepr):
    """The response of a settled shape to small forces and moments.

    Attributes
    ----------
    shape : Shape
    hold : "tension" or "length"
        The quantity that the motors keep constant.
    at : float
        Arc length of the loaded point [m].
    compliance : (6, 6)
        Displacement [m] and rotation [rad] of the point per force [N] and moment [N m] on the
        midline, in the base frame.
    tension_response : (n_tendons, 6)
        Change of each tension per force and moment [N per N, N per N m]; zero at constant tension.
    locked : tuple of int
        Tendons of constant length.
    slack : tuple of str
        Tendons without tension. A locked tendon could only pull, not push; see `locked`.
    refinement : int
        Refinement of the mesh of the result.
    error : float
        Estimated relative error of the compliance at constant tensions.
    """

    shape: Shape
    hold: Hold
    at: float
    compliance: Array
    tension_response: Array
    locked: tuple[int, ...]
    slack: tuple[str, ...]
    refinement: int
    error: float

    @property
    def stiffness(self) -> Array:
        """Force [N] and moment [N m] per displacement [m] and rotation [rad] (6, 6).

        Raises SingularError with the direction if there is no compliance.
        """
        size = np.repeat([self.shape.arm.length, 1.0], 3)
        scaled = self.compliance / np.outer(size, size)
        values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        if np.abs(values).min() < 1e-12 * np.abs(values).max():
            stiff = vectors[:, np.argmin(np.abs(values))].round(3)
            raise SingularError(f"there is no compliance to (force, moment) along {stiff.tolist()}")
        return np.asarray(np.linalg.inv(self.compliance))

    @cached_property
    def _response(self) -> Response:
        return sensitivities(self.shape, self.at, self.refinement)

    @property
    def stable(self) -> bool:
        """Whether the shape is a minimum of the energy at constant tensions."""
        return self._response.stable

    @property
    def pose_tension(self) -> Array:
        """Displacement and rotation (6, n_tendons) per newton at each motor [m/N, rad/N]."""
        return self._response.pose_tension

    @property
    def length_tension(self) -> Array:
        """Length of each tendon per newton in each tendon (n_tendons, n_tendons) [m/N]."""
        return self._response.length_tension

    @property
    def pose_length(self) -> Array:
        """Displacement and rotation (6, n_tendons) per metre of each tendon paid out [-, rad/m]."""
        return np.asarray(self.pose_tension @ np.linalg.pinv(self.length_tension, _RANK_TOL))

    def section(self, s: Any) -> Array:
        """Flexural stiffness of the section about n and b (2,) or (N, 2) at s [N m2].

        The result is d(moment) / d(curvature) at constant tensions: E J + sum of y^2 T with the
        paper's tangent, and the second derivatives of the energy with exact tendons.
        """
        return self._sections(s)[..., 1:3]

    def torsional(self, s: Any) -> Array:
        """Torsional stiffness of the section at s, a scalar or (N,) [N m2]."""
        return self._sections(s)[..., 0]

    def axial(self, s: Any) -> Array:
        """Axial stiffness of the section at s, a scalar or (N,) [N]; infinite without extension."""
        return self._sections(s)[..., 3]

    def ellipsoid(self) -> tuple[Array, Array]:
        """Return half axes (3,) and directions (3, 3) of the ellipsoid of displacements by 1 N.

        Half axes are in m/N, softest first. Directions are columns in the base frame.
        """
        directions, axes, _ = np.linalg.svd(self.compliance[:3, :3])
        return axes, directions

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm and the compliance ellipsoid in 3-D; see plot_ellipsoids.

        Return a new Figure, or the given 3-D axes.
        """
        return plotted(self, ax)

    def __repr__(self) -> str:
        arm = self.shape.arm
        T = self.shape.tensions
        held = "tensions held" if self.hold == "tension" else "lengths locked"
        place = "the tip" if self.at == arm.length else f"s = {1e3 * self.at:g} mm"
        rows = [["[mm/N]", "force x", "force y", "force z"]]
        for axis, row in zip("xyz", 1e3 * self.compliance[:3, :3], strict=True):
            rows.append([f"  {axis} moves by", *(f"{value:.4g}" for value in row)])
        axes = [["principal axes", "[mm/N]"]]
        half, directions = self.ellipsoid()
        for i, name in enumerate(("softest", "between", "stiffest")):
            along = ", ".join(f"{x + 0.0:.3f}" for x in directions[:, i].round(3))
            axes.append([f"  {name}", f"{1e3 * half[i]:.4g}", f"along [{along}]"])
        head = f"compliance of {place}, {held}"
        parts = [
            tendon_table("tensions [N]", arm.tendons_by_section, T),
            "\n".join([head, *columns(rows), "", *columns(axes)]),
        ]
        if self.hold == "length" and self.slack:
            remark = "without tension, left slack (release=False locks them)"
            if len(self.locked) + len(self.slack) > T.size:
                remark = "without tension and locked, though they could only pull"
            parts.append(f"{remark}: {', '.join(self.slack)}")
        stable = "stable" if self.stable else "not stable"
        last = f"{stable} with tensions held; estimated relative error [-]  {self.error:.1e}"
        return "\n\n".join([*parts, last])

    def _sections(self, s: Any) -> Array:
        values = section_stiffness(self.shape, arc_lengths(s))
        return np.asarray(values[0] if np.ndim(s) == 0 else values)


def stiffness(
    arm: Arm,
    tensions: Any = None,
    scene: Scene | None = None,
    hold: Hold | None = None,
    at: float | Literal["tip"] = "tip",
    *,
    accuracy: float = ACCURACY,
    tendon_EA: float | None = None,
    release: bool = True,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    lengths: Any = None,
    tendon_outside: float = 0.0,
    near: Shape | None = None,
    time_limit: float | None = None,
) -> Stiffness:
    """Return the response of a settled arm to a small force and moment.

    Parameters
    ----------
    arm, tensions, scene
        See settle.
    hold : "tension" or "length"
        The quantity that the motors keep constant. The default is "length" if `lengths` are given,
        otherwise "tension". At constant lengths the tensions respond.
    at : float or "tip"
        Arc length of the loaded point [m].
    accuracy : float
        Accepted relative error of the compliance, and accepted tip error over arm length.
    tendon_EA : float
        Stiffness E A of the tendons [N]; the default is inextensible tendons. A stretched tendon is
        as long as its path, and shorter without tension.
    release : bool
        Whether tendons without tension are slack at constant lengths. They could only pull, and
        resist one of two opposite displacements at most. False locks all tendons, which is stiffer.
        With `lengths`, slack tendons stay slack in any case.
    compile : bool or "auto"
        Whether to use compiled code, see settle.
    lengths, tendon_outside
        See settle, together with `tendon_EA`. Tendons with given lengths are locked.
    near : Shape
        See settle: the shape from which the arm moves, for friction of contact.
    time_limit : float
        Time limit [s].

    Raises
    ------
    InputError
        If an argument is not allowed.
    CollapsedError, ConvergenceError, SnapError, CompilerError, TimeLimitError
        As settle does.
    """
    with limited(time_limit):
        if hold is None:
            hold = "tension" if lengths is None else "length"
        scene, place = _checked(arm, scene, hold, at, tendon_EA)
        release = flag("release", release)
        shape = settle(
            arm,
            tensions,
            scene,
            accuracy,
            compile,
            lengths=lengths,
            tendon_EA=None if lengths is None else tendon_EA,
            tendon_outside=tendon_outside,
            near=near,
        )
        point, mesh, error = compliance_of(shape, place, accuracy)
        pulling = is_taut(arm, shape.tensions)
        slack = tuple(arm.tendon_name(int(j)) for j in np.flatnonzero(~pulling))
        locked = np.flatnonzero((pulling | (not release)) & (hold == "length"))
        if hold == "length" and shape.winches is not None:
            locked = np.flatnonzero(shape.winches.held & pulling)
        response = np.zeros((shape.tensions.size, 6))
        if locked.size:
            longer = point.length_wrench[locked]
            response[locked] = by_lengths(shape, point, locked, longer, tendon_EA or np.inf)
        return Stiffness(
            shape=shape,
            hold=hold,
            at=place,
            compliance=point.pose_wrench + point.pose_tension @ response,
            tension_response=response,
            locked=tuple(locked.tolist()),
            slack=slack,
            refinement=mesh,
            error=error,
        )


def _checked(
    arm: Arm, scene: Scene | None, hold: Any, at: Any, tendon_EA: Any
) -> tuple[Scene, float]:
    scene = checked_scene(arm, scene, contact=True)
    literal("hold", hold, Hold)
    check_responses(scene)
    if tendon_EA is not None:
        checked_EA(tendon_EA)
    place = arm.length if isinstance(at, str) and at == "tip" else at
    if isinstance(place, str):
        raise InputError("at", at, f'"tip", or an arc length up to {arm.length:g} m')
    return scene, within("at", place, 1e-6 * arm.length, arm.length)


def tip_jacobian(
    arm: Arm,
    tensions: Any,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
) -> Array:
    """Return displacement [m/N] and rotation [rad/N] of the tip per tension (6, n_tendons).

    Components are in the base frame. Without loads, derivatives are exact for the mesh on which the
    arm settles to the accuracy. Under loads, the mesh is refined to the same accuracy of the
    derivatives. See settle for the parameters.

    Raises
    ------
    InputError, CollapsedError, ConvergenceError, SnapError, CompilerError
        As settle does.
    """
    scene = checked_scene(arm, scene)
    if is_coupled(arm, scene):
        return stiffness(arm, tensions, scene, accuracy=accuracy, compile=compile).pose_tension
    shape = settle(arm, tensions, scene, accuracy, compile=compile)
    point = shape.equilibrium
    assert isinstance(point, ExplicitEquilibrium)
    if isinstance(point.forward, ClosedForm):
        return ExplicitSensitivities(point, point.mesh.elements).pose_tension
    function = tip_jacobian_function(arm, scene, shape.refinement)
    return np.array(function(shape.tensions))


@lru_cache(maxsize=64)
def tip_jacobian_function(arm: Arm, scene: Scene, refinement: int) -> ca.Function:
    """Return jacobian_function of the forward map on the mesh of a refinement."""
    return jacobian_function(explicit_map(arm, scene, refinement))


def jacobian_function(forward: ExplicitMap) -> ca.Function:
    """Return tensions (n,) -> displacement [m/N] and rotation [rad/N] of the tip (6, n)."""
    arm = forward.arm
    T = ca.MX.sym("T", arm.n_tendons)
    pose = forward.function(T)[0][:, -1]
    jacobian = ca.densify(ca.jacobian(pose, T))
    q = ca.SX.sym("q", 4)
    change = ca.SX.sym("change", 4)
    rotation = 2 * multiply(change, conjugate(q) / ca.sumsqr(q))[1:]
    turned = ca.Function("turned", [q, change], [rotation]).map(arm.n_tendons)
    result = ca.vertcat(jacobian[4:, :], turned(pose[:4], jacobian[:4, :]))
    return ca.Function("tip_jacobian", [T], [result])
