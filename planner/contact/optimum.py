"""Optima of an arm in contact near an equilibrium: steps in its tensions, each of them settled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.contact.contacts import touches_of
from model.contact.forward import TouchingMap
from model.contact.friction import path_sensitivities
from model.contact.touches import Touches, forces
from model.equilibrium.equilibrium import Collocated, check_stretch
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stability
from model.loads import without_friction
from model.paths import Array
from model.time_limit import check_time
from planner.contact.grasp import Grasp
from planner.contact.load_path import LoadPath, rubs
from planner.contact.reduced import Optimality, Reduced, Settle
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# Residuals that are met, and that are nearly met: from there constraints are tried once more.
_MET, _NEARLY = 1e-7, 1e-2
# How often steps begin anew as other places touch.
_ROUNDS = 5
# Forces that do not press, over what bends the arm by 1 rad.
_PRESSED = 1e-8


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where steps in the tensions end.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    steps : LoadPath
        Tensions by which the arm was led there, its own last.
    violation : float
        The largest of a constraint; 0 where all are met.
    optimality : Optimality
    least : float
        The stability that it was constrained to; 0 without.
    """

    here: Linearised
    steps: LoadPath
    violation: float
    optimality: Optimality
    least: float

    @property
    def effort(self) -> float:
        """Root of the sum of squared tensions [N]."""
        return float(np.linalg.norm(self.here.tensions))

    @property
    def stability(self) -> float:
        """See model.equilibrium.stability."""
        return stability(self.here)


class Equilibria:
    """Equilibria of a task's arm under tensions, on a mesh of a refinement."""

    def __init__(self, task: Task, refinement: int) -> None:
        self.task, self.refinement = task, refinement
        self._mesh = STAGES, refinement, stations_of(task.arm, task.targets), task.machine_code
        self.map = TouchingMap(task.arm, task.scene, *self._mesh)

    def settled(self, tensions: Array, near: Linearised | None = None) -> Linearised:
        """Return the equilibrium from rest, or next to another; raises what settling does."""
        begin = None if near is None else Collocated(near, self.refinement)
        here = self.map.led(tensions, begin, jumps=False).settled.here
        check_stretch(Collocated(here, self.refinement))
        return here

    def along(self, load_path: LoadPath) -> Linearised:
        """Return the equilibrium at the end of a load path; raises what settling does."""
        here = None
        if rubs(self.task.scene):
            smooth = TouchingMap(self.task.arm, without_friction(self.task.scene), *self._mesh)
            here, load_path = smooth.equilibrium(np.array(load_path[0])).point, load_path[1:]
        for T in load_path:
            check_time()
            here = self.settled(np.array(T), here)
        assert here is not None
        return here

    def near(self, here: Linearised) -> Settle:
        """Return how shapes are settled near one: each from the last, or with friction from there.

        In a straight line of tensions then, against which friction acts all along.
        """
        last, begin = here, Collocated(here, self.refinement)

        def settle(tensions: Array) -> tuple[Linearised, Array]:
            nonlocal last
            if rubs(self.task.scene):
                end = self.map.led(tensions, begin, jumps=False)
                return end.settled.here, path_sensitivities(end.path)
            if not np.array_equal(tensions, last.tensions):
                last = self.settled(tensions, last)
            return last, self._released(last).by_tensions

        return settle

    def optimum(self, here: Linearised, start: Array | None = None, least: float = 0.0) -> Optimum:
        """Return the optimum that steps lead to from an equilibrium.

        With a stability of at least so much. Where the constraints cannot be met from there, where
        they are violated least. Raises what settling the start does.
        """
        steps, program = [here.tensions], Reduced(self.task, self.near(here), least)

        def visit(y: Array) -> None:
            steps.append(program.tensions(y))

        y = program.start(here) if start is None else start / program.unit
        for _ in range(_ROUNDS):
            size, y = y.size, program.solve(y, visit)
            if program.rows(y).violation > _MET:
                y = program.nearest(y)
                visit(y)
                if _MET < program.rows(y).violation < _NEARLY:
                    y = program.solve(y, visit)
            here = program.rows(y).here
            if program.start(here).size == size:
                break
            y = program.start(here)
        violation = program.rows(y).violation
        path = tuple(tuple(T.tolist()) for T in (*steps, here.tensions))
        met = violation <= _MET
        return Optimum(here, path, 0.0 if met else violation, program.optimality(y), least)

    def optimality(self, here: Linearised, settle: Settle, least: float) -> Optimality:
        """Return how far an equilibrium is from an optimum, of those that are settled so."""
        program = Reduced(self.task, settle, least)
        return program.optimality(program.start(here))

    def _released(self, here: Linearised) -> Linearised:
        """Return an equilibrium whose points that do not press count as free; itself without."""
        touches, force = Touches.of(here.system), forces(here.system, here.states)
        least = _PRESSED * float(np.max(natural_tensions(self.task.arm)))
        light = touches.point & (force <= least)
        if not light.any():
            return here
        touches.point[light], touches.curve[light] = False, 0.0
        return Linearised(touches.on(here.system), here.x)

    def wrench_left(self, here: Linearised) -> float:
        """Return what is left of the wrenches of holds, over their sizes."""
        left = 0.0
        for hold in (target for target in self.task.targets if isinstance(target, Hold)):
            grasp = Grasp.of(self.task.arm, touches_of(here), hold)
            wrench = grasp.scaled(grasp.left(grasp.best()))
            left += float(np.linalg.norm(wrench)) / hold.size(self.task.arm)
        return left
