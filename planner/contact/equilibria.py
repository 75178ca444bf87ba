"""Equilibria of a plan's arm in contact: along load paths, and near each other with derivatives."""

from __future__ import annotations

import numpy as np

from model.contact.contacts import touches_of
from model.contact.forward import TouchingMap
from model.contact.friction import path_sensitivities
from model.contact.touches import Touches, forces
from model.equilibrium.linearised import Linearised, check_stretch
from model.equilibrium.newton import STAGES
from model.equilibrium.stability import stability
from model.errors import SnapError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.grasp import Grasp
from planner.contact.load_path import LoadPath, rubs
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# The meshes of searches and of plans; forces that do not press, over what bends the arm by 1 rad.
COARSE, FINE, _PRESSED = 1, 2, 1e-8


class Equilibria:
    """Equilibria of a task's arm under tensions, on a mesh of a refinement."""

    def __init__(self, task: Task, refinement: int) -> None:
        self.task = task
        at = stations_of(task.arm, task.targets)
        self.map = TouchingMap(task.arm, task.scene, STAGES, refinement, at, task.machine_code)

    def settled(self, tensions: Array, near: Linearised | None = None) -> Linearised:
        """Return the equilibrium from rest, or next to another; raises what settling does."""
        point = self.map.solve(tensions, near, jumps=False)
        check_stretch(point)
        return point

    def along(self, load_path: LoadPath) -> Linearised:
        """Return the equilibrium at the end of a load path; raises what settling does.

        Friction acts beyond the first tensions.
        """
        first, *others = (np.array(T) for T in load_path)
        point: Linearised = self.map.without_friction.solve(first)
        for T in others:
            check_time()
            point = self.settled(T, point)
        return point

    def beside(
        self, tensions: Array, near: Linearised, begin: Linearised
    ) -> tuple[Linearised, Array]:
        """Return the equilibrium next to another, and its states' derivatives by the tensions.

        These are (n_states, n_tendons). With friction it is come to in a straight line of tensions
        from where the arm began, against which friction acts all along.
        """
        if rubs(self.task.scene):
            end = self.map.solve(tensions, begin, jumps=False)
            return end, path_sensitivities(end.path)
        point = self.settled(tensions, near)
        if stability(point) < 0:
            raise SnapError(1.0, "it is unstable next to another equilibrium")
        return point, self._released(point).by_tensions

    def _released(self, point: Linearised) -> Linearised:
        """Return an equilibrium whose points that do not press count as free; itself without."""
        touches, force = Touches.of(point.system), forces(point.system, point.states)
        least = _PRESSED * float(np.max(natural_tensions(self.task.arm)))
        light = touches.points & (force <= least)
        if not light.any():
            return point
        for flags in (touches.held, touches.moves, touches.curve):
            flags[light] = 0
        return Linearised(touches.on(point.system), point.x)

    def wrench_left(self, point: Linearised) -> float:
        """Return what is left of the wrenches of holds, over their sizes."""
        holds = [target for target in self.task.targets if isinstance(target, Hold)]
        grasps = [Grasp.of(self.task.arm, touches_of(point), hold) for hold in holds]
        return sum(float(np.linalg.norm(grasp.least)) for grasp in grasps)
