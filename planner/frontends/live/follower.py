"""Tensions that follow what is dragged: Gauss-Newton steps from equilibrium to equilibrium.

Each step settles the arm near the shape before and takes the tensions of least effort that bring
it nearer, by the derivatives of that shape. It needs no optimum to begin with, so that the arm
moves on where a plan has to be searched for; the plan of what is reached comes after. Under loads
it is on a coarse mesh, no step leads to an unstable shape, and one that would is held to
a margin of stability. Limits of strokes and of the total pull are the plan's.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from octoplan.model.arm import Arm
from octoplan.model.compliance import at_node
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.equilibrium.newton import STAGES, Start, newton
from octoplan.model.equilibrium.stability import is_stable, stability_slope
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.obstacles import Obstacle
from octoplan.model.extensions.obstacles.base import distances_from
from octoplan.model.forward import by_collocation
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import loosest, settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError, SingularError
from octoplan.model.support.progress import limited
from octoplan.planner.certificate import BRINK
from octoplan.planner.frontends.live.handles import Goal
from octoplan.planner.limits import Limits, natural_tensions

# What is drawn is as accurate as a pixel or so, over the arm's length: nearer than that the arm is
# there. So much counts also the tension that bends the arm by 1 rad, beside what is missed.
ACCURACY = 1e-3
# The farthest that a step goes, over the arm's length or in rad; how often it is tried.
_FAR, _TRIALS = 0.15, 6
# What does not settle in that time [s] is no step nearby.
_LONG = 1.0
# How firmly the least stability that is stepped to, BRINK, is held beside an arm length missed.
_FIRM = 10.0
# A step that brings less than this share of what is missed and of effort, squared, is the last.
_STILL = 3e-3
# Within this of the goal, over the arm's length, effort may fall while the goal is missed by more:
# the next step makes up for that.
_BAND = 0.8 * ACCURACY


class _Rows(NamedTuple):
    """The linearised problem of a shape.

    What changes of tensions do to what is missed (rows, n_tendons), what is missed of the goal, and
    by how much nodes are too near to obstacles, over the arm's length.
    """

    by_tensions: Array
    missed: Array
    gaps: Array


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

        Raises OctoplanError where the arm has no stable shape.
        """
        self.limits, self.around = limits, around
        self._low, self._high = np.array(limits.lower), np.array(limits.upper)
        # What bends the arm by 1 rad. One unit for all of effort, which is what plans make least.
        self._natural = natural_tensions(arm)
        self._unit = float(self._natural.mean())
        # What each tendon alone bends the arm by in a step is up to `_reach`, 1 rad at most.
        self._machine_code, self._reach, self.brink = machine_code, 1.0, False
        # The stability, and its derivatives by tensions (n_tendons,) [1/N]; unless it is held.
        self._unheld = np.inf, np.zeros(arm.n_tendons)
        start = self._low if tensions is None else np.clip(tensions, self._low, self._high)
        self.begin(settle(arm, start, scene, ACCURACY, compile=machine_code))

    def begin(self, shape: Shape) -> None:
        """Go on from a shape of the arm; under loads on the coarse mesh if it is stable there."""
        self.shape, self._stability, point = shape, self._unheld, _under_loads(shape)
        if point is not None:
            code = self._machine_code
            coarse = by_collocation(shape.arm, shape.scene, STAGES, 1, machine_code=code)
            result = self._near(coarse, point, shape.tensions)
            self.shape = shape if result is None else replace(result, refinement=1)

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

        Where it leads to nothing better it is taken again from a smaller trust region, a box. Where
        the linearised problem promises nothing better it is not taken at all.
        """
        T, rows = self.shape.tensions, self._rows(goal)
        for _ in range(_TRIALS):
            wanted = np.clip(T + self._tension_step(rows), self._low, self._high)
            worth = self._merit(rows.missed, rows.gaps, T, self._stability[0])
            if self._predicted_merit(rows, wanted - T) > (1 - _STILL) * worth:
                if self._reach == 1.0:
                    break
                self._reach = 1.0  # little is promised of a small region
                continue
            result = self._settled(wanted)
            if result is not None:
                stability = _stability(result) if self.brink else self._unheld
                missed, gaps = goal.residual(result), self._gaps(result)[0]
                merit = self._merit(missed, gaps, wanted, stability[0])
                if merit < worth:
                    self.shape, self._stability = result, stability
                    self._reach = min(2 * self._reach, 1.0)
                    return merit < (1 - _STILL) * worth
            self._reach, self.brink = self._reach / 4, _under_loads(self.shape) is not None
        self._reach = 1.0
        return False

    def _rows(self, goal: Goal) -> _Rows:
        """Return the linearised problem: of the goal, and of nodes that are too near obstacles."""
        shape = self.shape
        gaps, ways = self._gaps(shape)
        at, which = np.nonzero(gaps > 0)
        nodes = [int(np.abs(shape.s - goal.s).argmin()), *(at + 1).tolist()]
        moved = [at_node(shape.equilibrium, node).pose_tension for node in nodes]
        keep = [way @ each[:3] for way, each in zip(ways[at, which], moved[1:], strict=True)]
        rows = [goal.jacobian(shape, moved[0]), *(row[None] / shape.arm.length for row in keep)]
        return _Rows(np.vstack(rows), goal.residual(shape), gaps[at, which])

    def _tension_step(self, rows: _Rows) -> Array:
        """Return the change of tensions that meets rows best, of least effort, within limits.

        A part of the way if the goal is far. Once a step was refused stability is held to its
        margin where it would fall below.
        """
        T, effort = self.shape.tensions, ACCURACY / self._unit
        part = min(1.0, _FAR / max(float(np.linalg.norm(rows.missed)), 1e-12))
        matrix = np.vstack([rows.by_tensions, effort * np.eye(T.size)])
        right = np.concatenate([part * rows.missed, rows.gaps, -effort * T])
        reach = self._reach * self._natural
        low = np.maximum(self._low - T, -reach) - 1e-12
        bounds = low, np.maximum(np.minimum(self._high - T, reach), low + 2e-12)
        change = lsq_linear(matrix, right, bounds, method="bvls").x
        if self.brink:
            if self._stability is self._unheld:
                self._stability = _stability(self.shape)
            value, slope = self._stability
            self.brink = bool(value + slope @ change < BRINK)
            if self.brink:
                matrix = np.vstack([matrix, _FIRM * slope])
                right = np.append(right, _FIRM * (BRINK - value))
                change = lsq_linear(matrix, right, bounds, method="bvls").x
        return np.asarray(change)

    def _settled(self, tensions: Array) -> Shape | None:
        """Return the shape under tensions nearby; None where the arm would snap or be crushed.

        Under loads it is on the same mesh, and nothing far is searched for.
        """
        shape, point = self.shape, _under_loads(self.shape)
        try:
            if point is not None:
                return self._near(Collocation(point.system), point, tensions)
            code = self._machine_code
            with limited(_LONG):
                return settle(shape.arm, tensions, shape.scene, ACCURACY, compile=code, near=shape)
        except OctoplanError:
            return None

    def _near(self, forward: Collocation, now: Equilibrium, tensions: Array) -> Shape | None:
        """Return the shape on a mesh near the one now; None where none is stable there."""
        guess, shape = forward.carried(tensions[None], [now])[0], self.shape
        (point,) = newton(forward.system, [Start(tensions, 1.0, guess, looser=loosest(ACCURACY))])
        if point is None or not is_stable(point):
            return None
        return Shape(shape.arm, shape.scene, ACCURACY, point, shape.refinement)

    def _predicted_merit(self, rows: _Rows, change: Array) -> float:
        """Return the merit after a change of tensions, were the arm as it is linearised."""
        by, n = rows.by_tensions @ change, rows.missed.size
        value, slope = self._stability
        T, value = self.shape.tensions + change, value + float(slope @ change)
        return self._merit(rows.missed - by[:n], rows.gaps - by[n:], T, value)

    def _merit(self, missed: Array, gaps: Array, tensions: Array, stability: float) -> float:
        """Return what is missed beyond what counts as there, and the effort, squared."""
        missing = np.sqrt(missed @ missed + np.sum(np.maximum(gaps, 0.0) ** 2))
        effort = ACCURACY * tensions / self._unit
        weak = _FIRM * max(BRINK - stability, 0.0) if self.brink else 0.0
        return float(weak**2 + max(missing - _BAND, 0.0) ** 2 + effort @ effort)

    def _gaps(self, shape: Shape) -> tuple[Array, Array]:
        """Return by how much the nodes of the arm are too near to obstacles, over its length.

        (nodes, obstacles), and the directions away from them (nodes, obstacles, 3).
        """
        if not self.around[0]:
            return np.zeros((0, 0)), np.zeros((0, 0, 3))
        arm, s = shape.arm, shape.s[1:]
        radius = arm.outer_radius(s)[0]
        gap, way = distances_from(self.around[0], shape.states[1:, None, 4:7])
        return (self.around[1] + radius[:, None] - gap) / arm.length, way


def _under_loads(shape: Shape) -> Equilibrium | None:
    """Return the equilibrium of a shape that loads bend, whose mesh is kept; None of others.

    What touches something is settled on meshes that do.
    """
    return None if contacts(shape.scene) or not is_loaded(shape.scene) else shape.known


def _stability(shape: Shape) -> tuple[float, Array]:
    """Return how stable a shape under loads is, 0 where it is about to buckle, and derivatives."""
    point = _under_loads(shape)
    assert point is not None
    try:
        return stability_slope(point)
    except SingularError:
        return 0.0, np.zeros(shape.tensions.size)
