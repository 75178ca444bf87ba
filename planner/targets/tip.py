"""Bring the tip to a place, with or without an orientation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.arm import Arm
from model.checks import finite_array
from model.errors import InputError
from model.paths import Array
from planner.targets.base import Free, Terms, View, check_near


@dataclass(frozen=True)
class TipPosition(Free):
    """The tip at a point.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    """

    position: tuple[float, ...]

    def __post_init__(self) -> None:
        point = finite_array("TipPosition.position", self.position, (3,))
        object.__setattr__(self, "position", tuple(point.tolist()))

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        check_near(arm, "TipPosition.position", self.position)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters."""
        return np.array(self.position)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(match={"tip position": (view.tip - p) / view.arm.length})

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {"tip position": np.array(self.position)}

    def guess_towards(self, arm: Arm) -> Array:
        """See Target.guess_towards."""
        return np.array(self.position)


@dataclass(frozen=True)
class TipPose(Free):
    """The tip at a point and its frame turned in a given way.

    Attributes
    ----------
    position : (3,)
        In the base frame [m].
    frame : (3, 3)
        Columns t, n, b wanted at the tip.
    """

    position: tuple[float, ...]
    frame: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        point = finite_array("TipPose.position", self.position, (3,))
        frame = finite_array("TipPose.frame", self.frame, (3, 3))
        square = np.clip(frame, -2, 2)
        if not np.allclose(square.T @ square, np.eye(3), atol=1e-6) or np.linalg.det(square) < 0:
            raise InputError("TipPose.frame", self.frame, "a right-handed orthonormal frame")
        object.__setattr__(self, "position", tuple(point.tolist()))
        object.__setattr__(self, "frame", tuple(tuple(row) for row in frame.tolist()))

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        check_near(arm, "TipPose.position", self.position)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the position, then the frame column by column."""
        return np.concatenate([self.position, np.array(self.frame).T.ravel()])

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: the turn is 2 sin(a / 2) about its axis, without a zero at a = pi."""
        turn = ca.reshape(p[3:], 3, 3).T @ view.tip_frame
        axis = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        doubled = ca.sqrt(ca.fmax(1 + ca.trace(turn), 1e-12))
        return Terms(
            match={"tip position": (view.tip - p[:3]) / view.arm.length, "tip turn": axis / doubled}
        )

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {"tip position": np.array(self.position), "tip frame": np.array(self.frame)}

    def guess_towards(self, arm: Arm) -> Array:
        """See Target.guess_towards."""
        return np.array(self.position)
