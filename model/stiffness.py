"""Stiffness of a settled arm, what a small force or moment does, and the Jacobian of its tip."""

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
from octoplan.model.forward import explicit_map
from octoplan.model.loads import check_responses, is_loaded
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, multiply
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, checked_scene, settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import arc_lengths, kind, literal, within
from octoplan.model.support.errors import InputError, SingularError
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import limited
from octoplan.model.support.text import HtmlRepr, columns, tendon_table
from octoplan.model.tendons import checked_EA, is_taut
from octoplan.model.unloaded.closed_form import ClosedForm
from octoplan.model.unloaded.march_derivative import MarchDerivative
from octoplan.model.unloaded.marched import ExplicitMap, Marched

Hold = Literal["tension", "length"]
# Smallest relative singular value of the lengths by the tensions that counts as determined.
_RANK_TOL = 1e-9


@dataclass(frozen=True, eq=False)
class Stiffness(HtmlRepr):
    """How a settled shape answers; always with what holds the tendons.

    Attributes
    ----------
    shape : Shape
        What was settled.
    hold : "tension" or "length"
    at : float
        Arc length of the point that is pushed and watched [m].
    compliance : (6, 6)
        Displacement [m] and rotation [rad] of the midline there per force [N] and moment [N m] on
        it, in the base frame.
    tension_response : (n_tendons, 6)
        Change of each tension per force and moment [N per N, N per N m]; zero where tension holds.
    locked : tuple of int
        Tendons whose length is held.
    slack : tuple of str
        Tendons without tension: locked, they could only pull, not push; see `locked`.
    refinement : int
        Of the mesh on which all this was found.
    error : float
        Estimated relative error of the compliance with tensions held.
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

        Raises SingularError, naming the direction, where there is no compliance.
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
        """Whether the shape is at a minimum of its energy under tensions that are held."""
        return self._response.stable

    @property
    def pose_tension(self) -> Array:
        """Displacement and rotation (6, n_tendons) per newton at each motor [m/N, rad/N]."""
        return self._response.pose_tension

    @property
    def length_tension(self) -> Array:
        """Length of each tendon per newton in each (n_tendons, n_tendons) [m/N], at the motors."""
        return self._response.length_tension

    @property
    def pose_length(self) -> Array:
        """Displacement and rotation (6, n_tendons) per metre of each tendon paid out [-, rad/m]."""
        return np.asarray(self.pose_tension @ np.linalg.pinv(self.length_tension, _RANK_TOL))

    def section(self, s: Any) -> Array:
        """Flexural stiffness of the section about n and b (2,) or (N, 2) at s [N m2].

        d(moment) / d(curvature) at held tensions: with the paper's tangent E J + sum of y^2 T, with
        exact tendons the second derivatives of the section's energy.
        """
        return self._sections(s)[..., 1:3]

    def torsional(self, s: Any) -> Array:
        """Torsional stiffness of the section at s, a scalar or (N,) [N m2]."""
        return self._sections(s)[..., 0]

    def axial(self, s: Any) -> Array:
        """Axial stiffness of the section at s, a scalar or (N,) [N]; infinite without extension."""
        return self._sections(s)[..., 3]

    def ellipsoid(self) -> tuple[Array, Array]:
        """Return the half axes (3,) of the ellipsoid of displacements by 1 N, and their directions.

        Axes in m/N, softest first; directions (3, 3) are columns in the base frame.
        """
        directions, axes, _ = np.linalg.svd(self.compliance[:3, :3])
        return axes, directions

    def __repr__(self) -> str:
        arm, T = self.shape.arm, self.shape.tensions
        held = "tensions held" if self.hold == "tension" else "lengths locked"
        place = "the tip" if self.at == arm.length else f"s = {1e3 * self.at:g} mm"
        rows = [["[mm/N]", "force x", "force y", "force z"]]
        for axis, row in zip("xyz", 1e3 * self.compliance[:3, :3], strict=True):
            rows.append([f"  {axis} moves by", *(f"{value:.4g}" for value in row)])
        axes, (half, directions) = [["principal axes", "[mm/N]"]], self.ellipsoid()
        for i, name in enumerate(("softest", "between", "stiffest")):
            along = ", ".join(f"{x + 0.0:.3f}" for x in directions[:, i].round(3))
            axes.append([f"  {name}", f"{1e3 * half[i]:.4g}", f"along [{along}]"])
        head = f"compliance of {place}, {held}"
        parts = [
            tendon_table("tensions [N]", arm.tendons_by_section, T),
            "\n".join([head, *columns(rows), "", *columns(axes)]),
        ]
        if self.hold == "length" and self.slack:
            what = "without tension, left slack (release=False locks them)"
            if len(self.locked) + len(self.slack) > T.size:
                what = "without tension and locked, though they could only pull"
            parts.append(f"{what}: {', '.join(self.slack)}")
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
    """Return how the shape that an arm takes under tensions answers to a small force and moment.

    Parameters
    ----------
    arm, tensions, scene
        As settle takes them.
    hold : "tension" or "length"
        What the motors hold: tension unless given, or where `lengths` are. Locked lengths make the
        tensions respond.
    at : float or "tip"
        Arc length of the point [m].
    accuracy : float
        Relative error of the compliance that is accepted, and tip error over arm length.
    tendon_EA : float
        Stiffness E A of the tendons themselves [N]; they do not stretch unless given. A tendon that
        is as long as its path under its tension is shorter without, as settle has its length.
    release : bool
        Whether tendons without tension count as slack where lengths are held: unless given, as
        they could only pull, and resist one of two opposite displacements at most. False locks
        them all, which is stiffer. By `lengths` what is slack stays so.
    compile : bool or "auto"
        Whether to work by machine code, see settle.
    lengths, tendon_outside
        As settle takes them, with `tendon_EA`: then the tendons that are held by length are locked.
    near : Shape
        As settle takes it: where the arm came from, that friction of contacts acts against.
    time_limit : float
        How long it may take [s]; none unless given.

    Raises
    ------
    InputError
        For what is not allowed, naming it.
    CollapsedError, ConvergenceError, SnapError, CompilerError, TimeLimitError
        As settle does.
    """
    with limited(time_limit):
        if hold is None:
            hold = "tension" if lengths is None else "length"
        scene, place = _checked(arm, scene, hold, at, tendon_EA)
        kind("release", release, bool | np.bool_, "True or False")
        held = {
            "lengths": lengths,
            "tendon_outside": tendon_outside,
            "compile": compile,
            "near": near,
        }
        if lengths is not None:
            held["tendon_EA"] = tendon_EA
        shape = settle(arm, tensions, scene, accuracy, **held)
        point, mesh, error = compliance_of(shape, place, accuracy)
        pulling = is_taut(arm, shape.tensions)
        slack = tuple(arm.tendon_name(int(j)) for j in np.flatnonzero(~pulling))
        locked = np.flatnonzero((pulling | (not release)) & (hold == "length"))
        if hold == "length" and shape.winches is not None:
            locked = np.flatnonzero(shape.winches.held & pulling)
        response = np.zeros((shape.tensions.size, 6))
        if locked.size:
            EA, longer = tendon_EA or np.inf, point.length_wrench[locked]
            response[locked] = by_lengths(shape, point, locked, longer, EA)
        C, held_fast = point.pose_wrench + point.pose_tension @ response, tuple(locked.tolist())
        return Stiffness(shape, hold, place, C, response, held_fast, slack, mesh, error)


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
    """Return how the tip moves [m/N] and rotates [rad/N] per tension (6, n_tendons), base frame.

    Exact for the shape on the mesh that settles it to the accuracy. Under loads derivatives come
    from the stiffness, whose mesh is refined until it is as accurate. `compile` is that of settle.

    Raises as settle does, and CompilerError.
    """
    scene = checked_scene(arm, scene)
    if is_loaded(scene):
        return stiffness(arm, tensions, scene, accuracy=accuracy, compile=compile).pose_tension
    shape = settle(arm, tensions, scene, accuracy, compile=compile)
    point = shape.equilibrium
    assert isinstance(point, Marched)
    if isinstance(point.march, ClosedForm):
        return MarchDerivative(point, point.mesh.steps).pose_tension
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
    q, change = ca.SX.sym("q", 4), ca.SX.sym("change", 4)
    rotation = 2 * multiply(change, conjugate(q) / ca.sumsqr(q))[1:]
    turned = ca.Function("turned", [q, change], [rotation]).map(arm.n_tendons)
    result = ca.vertcat(jacobian[4:, :], turned(pose[:4], jacobian[:4, :]))
    return ca.Function("tip_jacobian", [T], [result])
