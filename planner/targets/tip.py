"""Targets: position of the tip, with or without direction or frame."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Annotated

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rotations import from_matrix
from octoplan.model.support.checks import orthonormal
from octoplan.model.support.value import Direction, Matrix, Place, Positive, Rule, value
from octoplan.planner.targets.base import Target, Terms, View, check_near

POSITION = "tip position"
DIRECTION = "tip direction"
ROTATION = "tip rotation"


@value
class _AtPlace(Target):
    """Position of the tip; base class of the targets of this module."""

    position: Place

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        check_near(arm, f"{type(self).__name__}.position", self.position)

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {POSITION: np.array(self.position)}


@value
class TipPosition(_AtPlace):
    """Position of the tip.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    """

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters."""
        return np.array(self.position)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(equality={POSITION: (view.tip - p) / view.arm.length}, units={POSITION: "L"})


def _oriented(view: View, p: ca.MX, name: str, off: ca.MX, weights: tuple[float, float]) -> Terms:
    """Return the terms of a position and an orientation residual `off`, with their weights."""
    return Terms(
        equality={POSITION: (view.tip - p[:3]) / view.arm.length, name: off},
        weights=dict(zip((POSITION, name), weights, strict=True)),
        units={POSITION: "L", name: "rad"},
    )


@value
class TipPointing(_AtPlace):
    """Position of the tip and direction of its tangent; the rotation about the tangent is free.

    For a camera, a nozzle or a needle at the tip: five conditions, one fewer than TipPose.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    direction : (3,)
        Direction of the tip's tangent t in the base frame; of any length but 0.
    weights : (position, direction)
        Weights if position and direction cannot both be met: the sum of weights times squared
        residuals is minimised. The residuals are the distance over the arm's length, and
        2 sin(a / 2) with the angle a between the directions [rad].
    """

    direction: Direction
    weights: tuple[Positive, Positive] = (1.0, 1.0)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the position, and the quaternion of a frame with this tangent."""
        t = np.array(self.direction)
        n = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
        n /= np.linalg.norm(n)
        return np.append(self.position, from_matrix(np.column_stack([t, n, np.cross(t, n)])))

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: the rotation from such a frame, without the part about the tangent.

        The rotation (w, x, y, z) consists of a rotation by a perpendicular to the tangent, and a
        rotation (cos(r / 2), sin(r / 2), 0, 0) about the tangent. Then (y, z) has the norm
        sin(a / 2) for any r.
        """
        off = view.rotation_from(view.arm.length, p[3:])[1:]
        return _oriented(view, p, DIRECTION, off, self.weights)

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {**super().prescribed(arm), DIRECTION: np.array(self.direction)}


@value
class TipPose(_AtPlace):
    """Position and frame of the tip.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    frame : (3, 3)
        Wanted frame of the tip, columns t, n, b.
    weights : (position, rotation)
        Weights if position and frame cannot both be met: the sum of weights times squared residuals
        is minimised. The residuals are the distance over the arm's length, and 2 sin(a / 2) with
        the angle a of the rotation between the frames [rad].
    """

    frame: Annotated[Matrix, Rule(partial(orthonormal, rounding=1e-6))]
    weights: tuple[Positive, Positive] = (1.0, 1.0)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the position, then the frame's quaternion."""
        return np.append(self.position, from_matrix(np.array(self.frame)))

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms and View.rotation_from."""
        off = view.rotation_from(view.arm.length, p[3:])
        return _oriented(view, p, ROTATION, off, self.weights)

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {**super().prescribed(arm), "tip frame": np.array(self.frame)}
