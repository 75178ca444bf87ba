"""A plan: what is asked, checked; searched or followed; and the answer with what it can do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind, not_negative, positive
from model.errors import InputError
from model.ladder import checked_accuracy
from model.loads import check_loads
from model.scene import Scene
from planner.answer import Answer
from planner.avoidance.asked import surroundings
from planner.files import to_json, write_named
from planner.program.effort import check_norm
from planner.program.limits import Limits
from planner.program.statement import Form, Statement
from planner.question import check_looks, check_targets, checked_form, checked_margin
from planner.records.plan import plan_record
from planner.solve.around import Around
from planner.solve.follow import Known, follow
from planner.solve.found import Found
from planner.solve.search import Search
from planner.solve.task import Task
from planner.targets.base import Target


@dataclass(frozen=True, eq=False)
class Plan(Answer):
    """Tensions for a target, see Answer; and what is made of them."""

    def co_contract(self, level: float) -> Plan:
        """Return the plan for the same targets with every tendon pulling at least so hard [N].

        Where the statics let tensions change without the shape (a straight arm without extension,
        tendons that run parallel to the midline), the shape is the same; otherwise the targets are
        still met, if the limits allow. This plan is followed, so that the arm does not go over to
        another way of meeting them; only where it cannot be is it searched for.
        """
        least = np.maximum(not_negative("level", level), self.limits.lower)
        return plan(
            self.arm,
            self.targets,
            self.scene,
            self.limits.upper,
            tension_min=least,
            total_pull=self.limits.total,
            norm=self.statement.norm,
            form=self.statement.form,
            accuracy=self.accuracy,
            near=self,
            stability_margin=self.statement.margin,
            obstacles=self.surroundings.obstacles,
            clearance=self.surroundings.clearance,
            self_clearance=self.surroundings.of_itself,
        )

    def save(self, path: str | Path) -> Path:
        """Write the plan, its certificate and all that was asked to a .json file; see load_plan.

        The file is there whole or not at all. Raises InputError for another suffix, where it cannot
        be written, and for targets, effects and paths that are not the project's own.
        """
        return write_named(path, ".json", to_json(plan_record(self)))

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D with its tendons, tensions and target; see planner.plots.plan."""
        from planner.plots.plan import plot_plan

        return plot_plan(self, ax)


def plan(
    arm: Arm,
    target: Target | Iterable[Target],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    norm: Any = "2",
    form: Form | None = None,
    accuracy: float = 1e-6,
    starts: int = 14,
    near: Plan | None = None,
    time_limit: float | None = None,
    stability_margin: float = 0.0,
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target wants.

    Parameters
    ----------
    target : Target, or several to be met together
    scene : Scene
        The effects called for; the bare arm unless given.
    tension_max, tension_min : float, or one for each tendon
        [N].
    total_pull : float
        The most that all tendons together may pull [N]; no limit unless given.
    norm : "2", "1" or "inf"
        What effort is: root of the sum of squares, sum, or largest tension.
    form : "condensed" or "multiple-shooting"
        Unknowns of the problem: tensions alone, or with the states of all elements, which is the
        default.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length (angles: rad).
    starts : int
        The most first guesses that are tried; fewer are, once the best was found twice.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene: its optimum is
        followed to this target, which is some ten times sooner. Where that fails all starts are
        tried.
    time_limit : float
        [s]. What is best then is returned, and `outcome` says so; what the first plan for an arm
        and a scene needs to be set up is not cut short.
    stability_margin : float
        The least stability of the shape under its loads that is accepted, 0 to 1: the least
        eigenvalue of the scaled Hessian of the energy, which is 1 for an arm at rest and 0 where it
        is about to give way. With 0 the arm has to stand.
    obstacles : sequence of Obstacle
        What the arm keeps clear of, all along; see model.obstacles.
    clearance : float
        How far its surface stays from them [m].
    self_clearance : bool
        Whether it stays as far from itself and from the far side of its base plane.

    Returns
    -------
    Plan
        Also when the target cannot be met: then it is the nearest attainable shape, and
        `outcome` says how far off it is and what holds it.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; targets that contradict each other.
    """
    scene, targets = scene or Scene(), check_targets(arm, target)
    check_loads(arm, scene)
    form = checked_form(form)
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise InputError("starts", starts, "a whole number from 1")
    accuracy = checked_accuracy(accuracy)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    limits = Limits.of(arm, tension_max, tension_min, total_pull)
    check_looks(targets, scene, limits)
    margin = checked_margin(stability_margin)
    limited = total_pull is not None
    statement = Statement(form, check_norm(norm), limited=limited, margin=margin)
    around = surroundings(arm, targets, obstacles, clearance, self_clearance)
    task, avoidance = Task(arm, targets, scene, limits, statement, accuracy), None
    found = None if near is None else _followed(near, arm, scene, targets, limits, accuracy)
    if around:
        found, avoidance = Around(task, around).run(starts, seconds, found)
    elif found is None:
        found = Search(task).run(starts, seconds)
    return Plan(
        arm,
        scene,
        targets,
        limits,
        found.statement,
        found.tensions,
        found.lam_x,
        found.lam_g,
        accuracy,
        found.starts,
        found.stopped,
        around,
        avoidance,
    )


def _followed(
    near: Plan,
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    accuracy: float,
) -> Found | None:
    kind("near", near, Plan, "a Plan for the same arm and scene, or None")
    if near.arm != arm or near.scene != scene:
        raise InputError("near", "a plan for another arm or scene", "one for the same")
    if (near.limits.upper, near.limits.total) != (limits.upper, limits.total):
        return None
    found = (near.tensions, near.lam_x, near.lam_g)
    known = Known(near.targets, near.limits.lower, near.statement, *found)
    return follow(known, arm, scene, targets, limits, accuracy)
