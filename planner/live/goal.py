"""Where a point of the arm is to be: what a target asks, smooth wherever the arm is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.paths import Array
from model.shape import Shape
from planner.targets import BendingPlane, TipPose, TipPosition
from planner.targets.base import toward


@dataclass(frozen=True, eq=False)
class Goal:
    """Where a point of the arm is to be, and which of its axes are to point where.

    Attributes
    ----------
    s : float
        Arc length of the point [m].
    position : (3,) or None
        [m].
    axes : (3, 3)
        Directions of t, n, b as columns, nan where they are free.
    """

    s: float
    position: Array | None
    axes: Array

    def residual(self, shape: Shape) -> Array:
        """Return what is missed: position over the arm's length, then directions."""
        rows = [] if self.position is None else [self._off(shape) / shape.arm.length]
        frame = shape.frame(self.s)
        rows += [self.axes[:, k] - frame[:, k] for k in self._held]
        return np.concatenate(rows)

    def jacobian(self, shape: Shape, moved: Array) -> Array:
        """Return its derivatives by tensions (rows, n_tendons), up to the sign.

        By those of the pose at s (6, n_tendons).
        """
        rows = [] if self.position is None else [moved[:3] / shape.arm.length]
        frame = shape.frame(self.s)
        rows += [np.cross(moved[3:], frame[:, k], axisa=0, axisc=0) for k in self._held]
        return np.vstack(rows)

    def missed(self, shape: Shape) -> float:
        """Return the distance to the position [m], without one the angle to the axes [rad]."""
        if self.position is not None:
            return float(np.linalg.norm(self._off(shape)))
        chord = float(np.linalg.norm(self.residual(shape)))
        return 2 * float(np.arcsin(min(chord / 2, 1.0)))

    @property
    def _held(self) -> list[int]:
        return [k for k in range(3) if np.isfinite(self.axes[0, k])]

    def _off(self, shape: Shape) -> Array:
        return np.asarray(self.position) - np.asarray(shape.position(self.s))


def goal_of(arm: Arm, target: TipPosition | TipPose | BendingPlane) -> Goal:
    """Return where a target wants the tip, or the tangent at the end of a section."""
    if isinstance(target, BendingPlane):
        axes = np.full((3, 3), np.nan)
        axes[:, 0] = tangent(arm, target)
        return Goal(arm.sections[target.section - 1].at, None, axes)
    axes = np.array(target.frame) if isinstance(target, TipPose) else np.full((3, 3), np.nan)
    return Goal(arm.length, np.array(target.position), axes)


def tangent(arm: Arm, target: BendingPlane) -> Array:
    """Return the tangent (3,) that a bending plane wants."""
    along = np.cos(target.bend) * np.array(arm.base_frame)[:, 0]
    return np.asarray(along + np.sin(target.bend) * toward(arm, target.angle))
