"""An optimum that keeps clear, with the inequalities of its program."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.centreline import Centreline
from model.effects import PrintedStatics
from model.equilibrium.forward import STAGES, Collocation
from model.errors import OctoplanError
from model.paths import Array
from model.settle import settle
from planner.avoidance.rows import Avoidance
from planner.program.problem import Problem
from planner.program.statement import Statement
from planner.settled import settled
from planner.solve.ipopt import Solution
from planner.solve.task import Task


@dataclass(frozen=True, eq=False)
class Clear:
    """An optimum that keeps clear, and the inequalities of its program.

    `statement` is the task's, with the least stable mode held where it has to be.
    """

    task: Task
    avoidance: Avoidance | None
    solution: Solution
    statement: Statement

    @property
    def stated(self) -> Task:
        """The task with its inequalities and statement."""
        return replace(keeping(self.task, self.avoidance), statement=self.statement)


def keeping(task: Task, avoidance: Avoidance | None) -> Task:
    """Return a task with inequalities."""
    if avoidance is None or not avoidance.rows:
        return task
    return replace(task, targets=(*task.targets, avoidance))


def line_of(
    problem: Problem, T: Array, accuracy: float, finished: bool = False
) -> Centreline | None:
    """Return the centreline of a program's arm under tensions; None if it does not settle.

    Near the shape of the plan where that is `finished`: then it is asked for in any case.
    """
    asked = (problem.arm, T, problem.scene, accuracy)
    try:
        if problem.scene.has(PrintedStatics):
            return Centreline.of(settle(*asked))
        mesh = problem.statement.refinement
        places = tuple(Avoidance(()).stations(problem.arm))
        form = STAGES, mesh, places, True, problem.machine_code
        forward = Collocation(problem.arm, problem.scene, *form)
        near = settled(*asked, problem.machine_code).known if finished else None
        return Centreline.at_states(forward.system, forward.found(T, near).states)
    except OctoplanError:
        return None
