"""Target: points for the whole backbone."""

from __future__ import annotations

from typing import Annotated

import casadi as ca
import numpy as np
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.support.checks import finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text
from octoplan.model.support.value import Length, NotNegative, Place, value
from octoplan.planner.targets.base import Target, Terms, View, check_near


@value
class Backbone(Target):
    """Pass as close to points as the limits allow, in the sense of weighted least squares.

    Attributes
    ----------
    points : (m, 3)
        In the base frame [m].
    s : (m,)
        Arc lengths of the arm assigned to the points [m]; by default in proportion to the length of
        the chord from the base through the points, with the tip at the last point.
    weights : (m,)
        Weights of the squared distances, whose sum is minimised; 1 unless given.
    """

    points: Annotated[tuple[Place, ...], Meta(min_length=1)]
    s: tuple[Length, ...] | None = None
    weights: tuple[NotNegative, ...] | None = None

    def __post_init__(self) -> None:
        for name in ("s", "weights"):
            if getattr(self, name) is not None:
                finite_array(f"Backbone.{name}", getattr(self, name), (len(self.points),))
        if self.weights is not None and max(self.weights) == 0:
            raise InputError("Backbone.weights", self.weights, "numbers >= 0, not all 0")
        if self.s is not None and np.any(np.diff(self.s) <= 0):
            raise InputError("Backbone.s", self.s, "increasing arc lengths above 0 m")

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        check_near(arm, "Backbone.points", self.points)
        if self.s is not None and self.s[-1] > arm.length * (1 + 1e-12):
            raise InputError(
                "Backbone.s", self.s[-1], f"up to the arm's length, {length_text(arm.length)}"
            )
        apart = np.diff(self.stations(arm), prepend=0.0)
        if not np.all(apart >= 1e-6 * arm.length):
            allowed = "points apart from each other, and the first from the base"
            raise InputError("Backbone.points", self.points, allowed)

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations."""
        if self.s is not None:
            return self.s
        points = np.vstack([arm.base_position, self.points])
        chord = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))
        longest = max(chord[-1], np.finfo(float).tiny)
        return tuple((chord / longest * arm.length).tolist())

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the points, then the roots of the weights over their sum."""
        weights = np.array(self.weights or [1.0] * len(self.points))
        weights /= weights.max()
        return np.concatenate([np.ravel(self.points), np.sqrt(weights / weights.sum())])

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        stations = self.stations(view.arm)
        m = len(stations)
        gaps = [
            p[3 * m + i] * (view.position(s) - p[3 * i : 3 * i + 3]) / view.arm.length
            for i, s in enumerate(stations)
        ]
        name = "distance to the points"
        return Terms(soft_residual={name: ca.vertcat(*gaps)}, units={name: "L"})
