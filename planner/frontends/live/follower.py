"""Tensions that follow a moving goal, by Gauss-Newton steps from equilibrium to equilibrium.

Each step settles the arm from the shape before, and changes the tensions towards the goal with
least effort, by the derivatives of that shape. No initial optimum is needed, so that the arm moves
while a plan is searched for. Under loads the mesh is coarse; steps to unstable shapes are rejected
and repeated with a constraint on the stability margin. The follower ignores limits of strokes
and of the total pull; plans enforce both.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from octoplan.model.arm import Arm
from octoplan.model.compliance import at_node
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.modes import stability_slope
from octoplan.model.equilibrium.newton import Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.extensions.obstacles.base import Obstacle, distances_from
from octoplan.model.forward import collocation_map
from octoplan.model.loads import has_complementarity, is_coupled
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import initial_tolerance_factor, settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError, SingularError
from octoplan.model.support.progress import limited
from octoplan.planner.certificate import BRINK
from octoplan.planner.frontends.live.handles import Goal
from octoplan.planner.limits import TendonLimits, natural_tensions

# Miss, over the arm length, below which the arm is at the goal: about a pixel. ACCURACY is
# also the weight of the effort, in units of the mean tension that bends the arm by 1 rad.
ACCURACY = 1e-3
# Largest miss that a single step corrects, over the arm length or in rad.
_FAR = 0.15
# Maximal number of trust regions per step.
_TRIALS = 6
# Time limit for settling a shape [s]; a step that takes longer is rejected.
_LONG = 1.0
# Weight of a stability below BRINK relative to a miss of one arm length.
_FIRM = 10.0
# Relative decrease of the merit below which a step is the last.
_STILL = 3e-3
# Miss, over the arm length, that does not count in the merit, so that effort can decrease at the
# goal; the next step corrects the miss.
_BAND = 0.8 * ACCURACY


class _Rows(NamedTuple):
    """The linearised problem at a shape.

    Attributes
    ----------
    by_tensions : (rows, n_tendons)
        Changes of the residuals by the tensions, with opposite sign.
    missed : (n,)
        Residuals of the goal.
    gaps : (rows - n,)
        Violations of the clearance at nodes, over the arm length.
    """

    by_tensions: Array
    missed: Array
    gaps: Array


class Follower:
    """An arm whose tensions follow a goal.

    Attributes
    ----------
    shape : Shape
        The current shape.
    limits : TendonLimits
    around : (obstacles, clearance)
        Obstacles, and clearance [m].
    brink : bool
        Whether steps are constrained by the stability margin.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        limits: TendonLimits,
        around: tuple[tuple[Obstacle, ...], float],
        machine_code: bool = False,
        tensions: Array | None = None,
    ) -> None:
        """Settle the arm under tensions (n_tendons,) [N], the lower limits by default.

        Raises OctoplanError if the arm has no stable shape.
        """
        self.limits = limits
        self.around = around
        self._low = np.array(limits.lower)
        self._high = np.array(limits.upper)
        # Tensions that bend the arm by 1 rad (n_tendons,) [N].
        self._natural = natural_tensions(arm)
        # Unit of the effort [N]: one unit for all tendons, as in plans.
        self._unit = float(self._natural.mean())
        self._machine_code = machine_code
        # Trust region: bend that the tension change of each tendon causes alone [rad], at most 1.
        self._reach = 1.0
        self.brink = False
        # Stability and its derivatives by tensions (n_tendons,) [1/N] while not constrained.
        self._unheld = np.inf, np.zeros(arm.n_tendons)
        start = self._low if tensions is None else np.clip(tensions, self._low, self._high)
        self.begin(settle(arm, start, scene, ACCURACY, compile=machine_code))

    def begin(self, shape: Shape) -> None:
        """Continue from a shape of the arm; under loads, from the coarse mesh if stable there."""
        self.shape = shape
        self._stability = self._unheld
        point = _under_loads(shape)
        if point is not None:
            code = self._machine_code
            coarse = collocation_map(shape.arm, shape.scene, 1, machine_code=code)
            result = self._near(coarse, point, shape.tensions)
            self.shape = shape if result is None else replace(result, refinement=1)

    def approach(self, goal: Goal, seconds: float) -> bool:
        """Step towards a goal for this time [s]; return whether further steps bring it closer."""
        end = time.monotonic() + seconds
        while True:
            if not self._step(goal):
                return False
            if time.monotonic() >= end:
                return True

    def _step(self, goal: Goal) -> bool:
        """Take one step; return whether to continue.

        A step that does not decrease the merit is repeated with a smaller trust region, a box. A
        step is not taken if the linearised problem predicts no decrease.
        """
        T = self.shape.tensions
        rows = self._rows(goal)
        for _ in range(_TRIALS):
            wanted = np.clip(T + self._tension_step(rows), self._low, self._high)
            worth = self._merit(rows.missed, rows.gaps, T, self._stability[0])
            if self._predicted_merit(rows, wanted - T) > (1 - _STILL) * worth:
                if self._reach == 1.0:
                    break
                self._reach = 1.0  # the predicted decrease was limited by the trust region
                continue
            result = self._settled(wanted)
            if result is not None:
                stability = _stability(result) if self.brink else self._unheld
                missed = goal.residual(result)
                gaps = self._gaps(result)[0]
                merit = self._merit(missed, gaps, wanted, stability[0])
                if merit < worth:
                    self.shape = result
                    self._stability = stability
                    self._reach = min(2 * self._reach, 1.0)
                    return merit < (1 - _STILL) * worth
            self._reach /= 4
            self.brink = _under_loads(self.shape) is not None
        self._reach = 1.0
        return False

    def _rows(self, goal: Goal) -> _Rows:
        """Return the linearised problem: the goal, and nodes that violate the clearance."""
        shape = self.shape
        gaps, ways = self._gaps(shape)
        at, which = np.nonzero(gaps > 0)
        nodes = [int(np.abs(shape.s - goal.s).argmin()), *(at + 1).tolist()]
        moved = [at_node(shape.equilibrium, node).pose_tension for node in nodes]
        keep = [way @ each[:3] for way, each in zip(ways[at, which], moved[1:], strict=True)]
        rows = [goal.jacobian(shape, moved[0]), *(row[None] / shape.arm.length for row in keep)]
        return _Rows(np.vstack(rows), goal.residual(shape), gaps[at, which])

    def _tension_step(self, rows: _Rows) -> Array:
        """Return the tension change of a damped least-squares step within limits.

        If the goal is far, the step covers a part of the distance. If `brink` is set, the stability
        is kept at the margin.
        """
        T = self.shape.tensions
        effort = ACCURACY / self._unit
        part = min(1.0, _FAR / max(float(np.linalg.norm(rows.missed)), 1e-12))
        matrix = np.vstack([rows.by_tensions, effort * np.eye(T.size)])
        right = np.concatenate([part * rows.missed, rows.gaps, -effort * T])
        reach = self._reach * self._natural
        low = np.maximum(self._low - T, -reach) - 1e-12
        bounds = low, np.maximum(np.minimum(self._high - T, reach), low + 2e-12)
        change = _bounded_least_squares(matrix, right, bounds, self._high > self._low)
        if self.brink:
            if self._stability is self._unheld:
                self._stability = _stability(self.shape)
            value, slope = self._stability
            self.brink = bool(value + slope @ change < BRINK)
            if self.brink:
                matrix = np.vstack([matrix, _FIRM * slope])
                right = np.append(right, _FIRM * (BRINK - value))
                change = _bounded_least_squares(matrix, right, bounds, self._high > self._low)
        return np.asarray(change)

    def _settled(self, tensions: Array) -> Shape | None:
        """Return the shape under nearby tensions; None if the arm snaps or is crushed.

        Under loads the mesh stays, and only a nearby equilibrium is accepted.
        """
        shape = self.shape
        point = _under_loads(shape)
        try:
            if point is not None:
                return self._near(CollocationMap(point.system), point, tensions)
            code = self._machine_code
            with limited(_LONG):
                return settle(shape.arm, tensions, shape.scene, ACCURACY, compile=code, near=shape)
        except OctoplanError:
            return None

    def _near(self, forward: CollocationMap, now: Equilibrium, tensions: Array) -> Shape | None:
        """Return the shape on a mesh near the equilibrium `now`; None if no stable one is found."""
        guess = forward.transfer_states(tensions[None], [now])[0]
        shape = self.shape
        (point,) = newton(
            forward.system,
            [Start(tensions, 1.0, guess, tolerance_factor=initial_tolerance_factor(ACCURACY))],
        )
        if point is None or not is_stable(point):
            return None
        return Shape(shape.arm, shape.scene, ACCURACY, point, shape.refinement)

    def _predicted_merit(self, rows: _Rows, change: Array) -> float:
        """Return the merit that the linearised problem predicts for a change of tensions."""
        by = rows.by_tensions @ change
        n = rows.missed.size
        value, slope = self._stability
        T = self.shape.tensions + change
        value += float(slope @ change)
        return self._merit(rows.missed - by[:n], rows.gaps - by[n:], T, value)

    def _merit(self, missed: Array, gaps: Array, tensions: Array, stability: float) -> float:
        """Return the squared miss beyond the band, plus squared effort and lack of stability."""
        missing = np.sqrt(missed @ missed + np.sum(np.maximum(gaps, 0.0) ** 2))
        effort = ACCURACY * tensions / self._unit
        weak = _FIRM * max(BRINK - stability, 0.0) if self.brink else 0.0
        return float(weak**2 + max(missing - _BAND, 0.0) ** 2 + effort @ effort)

    def _gaps(self, shape: Shape) -> tuple[Array, Array]:
        """Return violations of the clearance, over the arm length (nodes, obstacles).

        Also return the directions away from the obstacles (nodes, obstacles, 3).
        """
        if not self.around[0]:
            return np.zeros((0, 0)), np.zeros((0, 0, 3))
        arm = shape.arm
        s = shape.s[1:]
        radius = arm.outer_radius(s)[0]
        gap, way = distances_from(self.around[0], shape.states[1:, None, 4:7])
        return (self.around[1] + radius[:, None] - gap) / arm.length, way


def _bounded_least_squares(
    matrix: Array, right: Array, bounds: tuple[Array, Array], free: NDArray[np.bool_]
) -> Array:
    """Return the least-squares solution within bounds; 0 for the unknowns that are not free.

    The active-set method takes as many iterations as unknowns and may end early if most bounds
    are active.
    """
    change = np.zeros(free.size)
    if free.any():
        low, high = (bound[free] for bound in bounds)
        change[free] = lsq_linear(matrix[:, free], right, (low, high), method="bvls").x
    return change


def _under_loads(shape: Shape) -> Equilibrium | None:
    """Return the equilibrium of a loaded shape, whose mesh is reused; None for other shapes.

    Shapes in contact need meshes that depend on the contact.
    """
    is_fixed = is_coupled(shape.arm, shape.scene) and not has_complementarity(shape.scene)
    return shape.collocated if is_fixed else None


def _stability(shape: Shape) -> tuple[float, Array]:
    """Return the stability of a loaded shape, 0 at buckling, and its derivatives by tensions."""
    point = _under_loads(shape)
    assert point is not None
    try:
        return stability_slope(point)
    except SingularError:
        return 0.0, np.zeros(shape.tensions.size)
