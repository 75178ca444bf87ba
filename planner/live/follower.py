"""Tensions that follow what is dragged: damped Gauss-Newton steps from equilibrium to equilibrium.

Each step settles the arm near the shape before and takes the tensions of least effort that bring
it nearer, by the derivatives of that shape. It needs no optimum to begin with, so that the arm
moves on where a plan has to be searched for; the plan of what is reached comes after. Limits of
strokes and of the total pull are the plan's.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from model.arm import Arm
from model.compliance import at_nodes
from model.equilibrium.equilibrium import Collocated
from model.errors import OctoplanError
from model.forward import collocation_map
from model.loads import contacts
from model.obstacles import Obstacle
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.time_limit import limited
from planner.program.limits import Limits, natural_tensions

# What is drawn is as accurate as a pixel or so; nearer than that the arm is there.
ACCURACY, THERE = 1e-3, 1e-3
# The farthest that a step goes, over the arm's length or in rad; how often a step is halved.
_FAR, _HALVED = 0.15, 5
# What does not settle in that time [s] is no step nearby.
_LONG = 1.0
# How much the tension that bends the arm by 1 rad counts beside an arm length that is missed.
_EFFORT = 1e-3
# A step that changes tensions by less than this share of them is the last.
_STILL = 3e-3
# Within this of the goal, over the arm's length, effort may fall while the goal is missed by more:
# the next step makes up for that.
_BAND = 0.8 * THERE


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


class Follower:
    """An arm whose tensions follow a goal.

    Attributes
    ----------
    shape : Shape
        As it is now.
    limits : Limits
    around : (obstacles, clearance)
        What it keeps clear of, and how far [m].
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        limits: Limits,
        around: tuple[tuple[Obstacle, ...], float],
        machine_code: bool = False,
        tensions: Array | None = None,
    ) -> None:
        """Settle the arm under tensions (n_tendons,) [N], the least unless given.

        Raises OctoplanError where the arm does not stand.
        """
        self.limits, self.around = limits, around
        self._low, self._high = np.array(limits.lower), np.array(limits.upper)
        # One unit for all tendons, so that effort is what plans make least.
        self._unit = float(natural_tensions(arm).mean())
        self._bodies = Bodies(around[0]) if around[0] else None
        # The share of a step that was taken last: where the arm is about to snap it is small.
        self._machine_code, self._share = machine_code, 1.0
        start = self._low if tensions is None else np.clip(tensions, self._low, self._high)
        self.shape = settle(arm, start, scene, ACCURACY, compile=machine_code)

    def approach(self, goal: Goal, seconds: float) -> bool:
        """Take steps towards a goal for so long; return whether more would bring it nearer."""
        end = time.monotonic() + seconds
        while True:
            if not self._step(goal):
                return False
            if time.monotonic() >= end:
                return True

    def _step(self, goal: Goal) -> bool:
        """Take one step; return whether that was not the last."""
        shape, missed = self.shape, goal.residual(self.shape)
        most = _FAR / max(float(np.linalg.norm(missed)), 1e-12)
        right, (gaps, ways) = missed * min(1.0, most), self._clear(shape)
        at, which = np.nonzero(gaps > 0)
        nodes = [int(np.abs(shape.s - goal.s).argmin()), *(at + 1).tolist()]
        moved = [each.pose_tension for each in at_nodes(shape, nodes)]
        matrix, room = goal.jacobian(shape, moved[0]), gaps[at, which]
        keep = np.reshape(
            [way @ each[:3] for way, each in zip(ways[at, which], moved[1:], strict=True)],
            (room.size, shape.tensions.size),
        )
        T = shape.tensions
        effort = _EFFORT / self._unit * np.eye(T.size)
        A = np.vstack([matrix, keep / shape.arm.length, effort])
        b = np.concatenate([right, room, -effort @ T])
        bounds = (self._low - T - 1e-12, np.maximum(self._high - T, self._low - T) + 1e-12)
        change = lsq_linear(A, b, bounds, method="bvls").x
        worth, share = self._merit(goal, shape), min(1.0, 4 * self._share)
        for _ in range(_HALVED):
            wanted = np.clip(T + share * change, self._low, self._high)
            result = self._settled(wanted)
            if result is not None and self._merit(goal, result) < worth:
                self.shape, self._share = result, share
                return bool(np.abs(change).max() > _STILL * max(np.abs(wanted).max(), 1e-9))
            share /= 4
        self._share = 1.0
        return False

    def _settled(self, tensions: Array) -> Shape | None:
        """Return the shape under tensions nearby; None where the arm would snap or be crushed.

        Under loads it is on the same mesh, and nothing far is searched for.
        """
        shape, code = self.shape, self._machine_code
        arm, scene, known = shape.arm, shape.scene, shape.known
        try:
            if known is None or contacts(scene):
                with limited(_LONG):
                    return settle(arm, tensions, scene, ACCURACY, compile=code, near=shape)
            forward = collocation_map(arm, scene, shape.scheme, shape.refinement, (), code)
            here = forward.near(tensions, known)
        except OctoplanError:
            return None
        if here is None:
            return None
        return Shape(arm, scene, shape.error, Collocated(here, shape.refinement))

    def _merit(self, goal: Goal, shape: Shape) -> float:
        """Return what is missed beyond what counts as there, and the effort, squared."""
        room = np.maximum(self._clear(shape)[0], 0.0)
        missed = float(np.sqrt(np.sum(goal.residual(shape) ** 2) + np.sum(room**2)))
        effort = _EFFORT * shape.tensions / self._unit
        return max(missed - _BAND, 0.0) ** 2 + float(effort @ effort)

    def _clear(self, shape: Shape) -> tuple[Array, Array]:
        """Return by how much the nodes of the arm are too near to obstacles, over its length.

        (nodes, obstacles), and the directions away from them (nodes, obstacles, 3).
        """
        if self._bodies is None:
            return np.zeros((0, 0)), np.zeros((0, 0, 3))
        arm, s = shape.arm, shape.s[1:]
        radius = arm.radius.evaluate(s, arm.length)[0]
        gap, way = self._bodies.at(shape.states[1:, None, 4:7])
        return (self.around[1] + radius[:, None] - gap) / arm.length, way
