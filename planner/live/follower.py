"""Tensions that follow what is dragged: Gauss-Newton steps from equilibrium to equilibrium.

Each step settles the arm near the shape before and takes the tensions of least effort that bring
it nearer, by the derivatives of that shape. It needs no optimum to begin with, so that the arm
moves on where a plan has to be searched for; the plan of what is reached comes after. Under loads
no step leads to a shape that does not stand, and one that would is held to a margin of stability.
Limits of strokes and of the total pull are the plan's.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.optimize import lsq_linear

from model.arm import Arm
from model.compliance import at_nodes
from model.equilibrium.newton import Collocation, newton
from model.equilibrium.stability import stability_slope, stands
from model.errors import OctoplanError
from model.loads import contacts, is_loaded
from model.obstacles import Obstacle
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.time_limit import limited
from planner.live.goal import Goal
from planner.program.limits import Limits, natural_tensions

# What is drawn is as accurate as a pixel or so; nearer than that the arm is there.
ACCURACY, THERE = 1e-3, 1e-3
# The farthest that a step goes, over the arm's length or in rad, and by each tendon alone [rad];
# how often it is tried.
_FAR, _REACH, _TRIALS = 0.15, 1.0, 6
# What does not settle in that time [s] is no step nearby.
_LONG = 1.0
# How much the tension that bends the arm by 1 rad counts beside an arm length that is missed.
_EFFORT = 1e-3
# The least stability that is stepped to, and how firmly it is held beside an arm length missed.
MARGIN, _FIRM = 0.1, 10.0
# A step that brings less than this share of what is missed and of effort, squared, is the last.
_STILL = 3e-3
# Within this of the goal, over the arm's length, effort may fall while the goal is missed by more:
# the next step makes up for that.
_BAND = 0.8 * THERE


class Follower:
    """An arm whose tensions follow a goal.

    Attributes
    ----------
    shape : Shape
        As it is now.
    limits : Limits
    around : (obstacles, clearance)
        What it keeps clear of, and how far [m].
    brink : bool
        Whether its stability holds it, so that it would not stand if it came nearer.
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
        # What bends the arm by 1 rad. One unit for all of effort, which is what plans make least.
        self._natural = natural_tensions(arm)
        self._unit = float(self._natural.mean())
        self._bodies = Bodies(around[0]) if around[0] else None
        self._machine_code, self._reach, self.brink = machine_code, _REACH, False
        self._heavy = is_loaded(scene) and not contacts(scene)
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
        """Take one step; return whether that was not the last.

        Where it leads to nothing better it is taken again from a smaller trust region, a box.
        """
        T, rows = self.shape.tensions, self._rows(goal)
        for _ in range(_TRIALS):
            wanted = np.clip(T + self._change(*rows), self._low, self._high)
            result, worth = self._settled(wanted), self._merit(goal, self.shape)
            merit = np.inf if result is None else self._merit(goal, result)
            if result is not None and merit < worth:
                self.shape, self._reach = result, min(2 * self._reach, _REACH)
                return merit < (1 - _STILL) * worth
            self._reach, self.brink = self._reach / 4, self._heavy
        self._reach = _REACH
        return False

    def _rows(self, goal: Goal) -> tuple[Array, Array]:
        """Return what changes of tensions do to what is missed, and what they are to do.

        (rows, n_tendons) and (rows,): to the goal, a part of the way if that is far, and to nodes
        of the arm that are too near to obstacles.
        """
        shape, missed = self.shape, goal.residual(self.shape)
        most = _FAR / max(float(np.linalg.norm(missed)), 1e-12)
        gaps, ways = self._clear(shape)
        at, which = np.nonzero(gaps > 0)
        nodes = [int(np.abs(shape.s - goal.s).argmin()), *(at + 1).tolist()]
        moved = [each.pose_tension for each in at_nodes(shape, nodes)]
        keep = [way @ each[:3] for way, each in zip(ways[at, which], moved[1:], strict=True)]
        rows = [goal.jacobian(shape, moved[0]), *(row[None] / shape.arm.length for row in keep)]
        return np.vstack(rows), np.append(missed * min(1.0, most), gaps[at, which])

    def _change(self, A: Array, b: Array) -> Array:
        """Return the change of tensions that meets rows best, of least effort, within limits.

        Once a step was refused stability is held to its margin where it would fall below.
        """
        T, effort, known = self.shape.tensions, _EFFORT / self._unit, self.shape.known
        rows = np.vstack([A, effort * np.eye(T.size)])
        right, reach = np.append(b, -effort * T), self._reach * self._natural
        low = np.maximum(self._low - T, -reach) - 1e-12
        bounds = low, np.maximum(np.minimum(self._high - T, reach), low + 2e-12)
        change = lsq_linear(rows, right, bounds, method="bvls").x
        if self.brink and known is not None:
            stability, slope = stability_slope(known)
            self.brink = bool(stability + slope @ change < MARGIN)
            if self.brink:
                rows = np.vstack([rows, _FIRM * slope])
                right = np.append(right, _FIRM * (MARGIN - stability))
                change = lsq_linear(rows, right, bounds, method="bvls").x
        return np.asarray(change)

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
            guess = Collocation.on(known.system).carried(tensions, known)
            here = newton(known.system, tensions, 1.0, guess)
        except OctoplanError:
            return None
        if here is None or not stands(here):
            return None
        return Shape(arm, scene, shape.error, here, shape.refinement)

    def _merit(self, goal: Goal, shape: Shape) -> float:
        """Return what is missed beyond what counts as there, and the effort, squared."""
        room = np.maximum(self._clear(shape)[0], 0.0)
        missed = float(np.sqrt(np.sum(goal.residual(shape) ** 2) + np.sum(room**2)))
        effort = _EFFORT * shape.tensions / self._unit
        weak = _FIRM * max(MARGIN - shape.stability, 0.0) if self.brink else 0.0
        return weak**2 + max(missed - _BAND, 0.0) ** 2 + float(effort @ effort)

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
