"""Bring the tip to a place: as it comes, pointing along a direction, or with a whole frame."""

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
from octoplan.model.support.quantities import Direction, Matrix, Place, Positive
from octoplan.model.support.value import Rule, value
from octoplan.planner.targets.base import Target, Terms, View, check_near

POSITION, DIRECTION, ROTATION = "tip position", "tip direction", "tip rotation"


@value
class _AtPlace(Target):
    """The tip at a point."""

    position: Place

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        check_near(arm, f"{type(self).__name__}.position", self.position)

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {POSITION: np.array(self.position)}


@value
class TipPosition(_AtPlace):
    """The tip at a point.

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
    """Return the terms of a tip at a point that is oriented somehow, with weights of both."""
    return Terms(
        equality={POSITION: (view.tip - p[:3]) / view.arm.length, name: off},
        weights=dict(zip((POSITION, name), weights, strict=True)),
        units={POSITION: "L", name: "rad"},
    )


@value
class TipPointing(_AtPlace):
    """The tip at a point, its tangent along a direction; how it rolls about that is free.

    What a camera, a nozzle or a needle at the tip needs: five conditions, one fewer than TipPose.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    direction : (3,)
        That the tangent t of the tip is to have, in the base frame; of any length but 0.
    weights : (position, direction)
        How much each counts where not both can be had: the sum of weights times squared residuals
        is made least, of distance over the arm's length and of 2 sin(a / 2), a being the angle
        between the directions [rad].
    """

    direction: Direction
    weights: tuple[Positive, Positive] = (1.0, 1.0)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the position, the quaternion of a frame with that tangent."""
        t = np.array(self.direction)
        n = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
        n /= np.linalg.norm(n)
        return np.append(self.position, from_matrix(np.column_stack([t, n, np.cross(t, n)])))

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: the rotation from such a frame, but for its part about the tangent.

        Of a rotation (w, x, y, z) = (cos(r / 2), sin(r / 2), 0, 0) about the tangent after one by a
        across it, (y, z) has the norm sin(a / 2), whatever r.
        """
        off = view.rotation_from(view.arm.length, p[3:])[1:]
        return _oriented(view, p, DIRECTION, off, self.weights)

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {**super().prescribed(arm), DIRECTION: np.array(self.direction)}


@value
class TipPose(_AtPlace):
    """The tip at a point with a frame.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    frame : (3, 3)
        VectorInterpreter t, n, b wanted at the tip.
    weights : (position, rotation)
        How much each counts where not both can be had: the sum of weights times squared residuals
        is made least, of distance over the arm's length and of 2 sin(a / 2), a being the angle of
        the rotation between the frames [rad].
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
