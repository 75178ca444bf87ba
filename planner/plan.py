"""Plans: the question is checked, then a plan nearby is followed or a search made."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.extensions.contact.effects import contacts, without_contacts
from octoplan.model.extensions.obstacles import check_obstacles
from octoplan.model.forward import checked_accuracy
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind, not_negative, positive, within
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import GRACE, OutOfTime, reserve, seconds_left, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.model.support.text import TextRepr, plotted
from octoplan.planner.answer import Answer
from octoplan.planner.blocks import STABILITY
from octoplan.planner.certificate import BRINK
from octoplan.planner.extensions.avoidance.around import ObstacleSearch, line_of
from octoplan.planner.extensions.avoidance.surroundings import Environment, surroundings
from octoplan.planner.extensions.contact.grasp import Grip, grips_of
from octoplan.planner.extensions.contact.load_path import is_same, rubs, settled_along
from octoplan.planner.extensions.contact.search import ContactSearch, check_contact, optimality_of
from octoplan.planner.extensions.contact.wrapping import (
    beside,
    beside_contacts,
    open_wrap,
    with_places_of,
    with_turns,
)
from octoplan.planner.extensions.warm_start import jump, warm_start
from octoplan.planner.frontends.io.files import to_json, write_named
from octoplan.planner.frontends.io.saved_records import plan_record
from octoplan.planner.limits import checked_limits
from octoplan.planner.planning_problem import (
    PlanningProblem,
    check_targets,
    checked_options,
    planned_scene,
)
from octoplan.planner.problem import Problem
from octoplan.planner.solution import Solution
from octoplan.planner.solve.refine import CORRECTIONS
from octoplan.planner.solve.search import Search
from octoplan.planner.targets.base import Target
from octoplan.planner.targets.hold import Hold
from octoplan.planner.targets.wrap import Wrap

# In contact the fraction of the time limit that is kept for shape and certificate until the search
# has measured how long the arm takes to settle.
CONTACT_SHARE = 0.25


@dataclass(frozen=True, eq=False, repr=False)
class Plan(TextRepr, Answer):
    """Tensions for a target; shape, certificate and outcome are derived from them."""

    @with_progress
    def certify(self, time_limit: float | None = None, progress: bool | None = None) -> Self:
        """Return the plan with shape and certificate computed anew, as `plan` does.

        Pass a longer `time_limit` [s], or none, if the limit of `plan` was reached before the
        certificate was complete. If the limit is reached, the outcome says so.
        """
        seconds = None if time_limit is None else positive("time_limit", time_limit)
        result = replace(self)
        with limited_to(seconds):
            result.complete()
        return result

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
            norm=self.options.norm,
            accuracy=self.accuracy,
            near=self,
            stability_margin=self.options.margin,
            compile=self.machine_code,
            **self.limits.keywords | {"tension_min": least},
            **({} if contacts(self.scene) else self.surroundings.keywords),
        )

    def save(self, path: str | Path) -> Path:
        """Write the plan, its certificate and its question to a .json file; see load_plan.

        The file is there whole or not at all. Raises InputError for another suffix, where it cannot
        be written, and for targets, effects and paths that are not the project's own.
        """
        return write_named(path, ".json", to_json(plan_record(self)))

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D with its tendons, tensions and target.

        See octoplan.planner.frontends.plots.plan.
        """
        return plotted(self, ax)


@dataclass(frozen=True, eq=False, repr=False)
class ContactPlan(Plan):
    """A plan for an arm in contact; see octoplan.planner.extensions.contact.

    Solution has its load path; `shape.snaps` tells where the arm jumps at last. With
    surroundings it is that of an arm which keeps clear of what it may lean on, and optimal among
    these.
    """

    def _settle(self) -> Shape:
        """Return the shape to which the load path leads."""
        arguments = (self.arm, self.load_path, np.ravel(self.tensions), self.scene)
        return settled_along(*arguments, max(self.accuracy / 10, 1e-12), self.machine_code)

    @cached_property
    def grips(self) -> tuple[Grip, ...]:
        """The forces on the objects that are held, by target and from base to tip."""
        holds = [target for target in self.targets if isinstance(target, Hold)]
        return tuple(grip for hold in holds for grip in grips_of(self.shape, hold))

    @cached_property
    def beside(self) -> Plan | None:
        """The same plan in the scene without contacts, of an arm that keeps clear of them."""
        if not self.surroundings:
            return None
        shared = {f.name: getattr(self, f.name) for f in fields(self)}
        return Plan(**shared | {"scene": without_contacts(self.scene)})

    @property
    def outcome(self) -> str:
        """See Answer.outcome."""
        leans = "It keeps clear of what it may lean on; leaning was not tried."
        return f"{super().outcome} {leans}" if self.beside and self.reached else super().outcome

    @property
    def problem(self) -> Problem:
        """See Answer.problem: that of the arm without contacts, where it keeps clear of them."""
        return self.beside.problem if self.beside else super().problem

    def _rows(self, name: str) -> Array:
        """See Answer._rows: where it leans stability alone holds beside limits of tensions."""
        if self.beside:
            return super()._rows(name)
        return np.array(self.lam_g[-1:] if name == STABILITY and self.options.modes else ())

    def _kkt(self) -> float:
        if self.beside:
            return self.beside._kkt()
        return optimality_of(self, np.ravel(self.tensions), self.shape, self.load_path)


@with_progress
def plan(
    arm: Arm,
    target: Target | Iterable[Target],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    norm: Any = "2",
    accuracy: float = 1e-6,
    starts: int | None = None,
    near: Plan | None = None,
    time_limit: float | None = None,
    stability_margin: float | None = None,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    stroke_max: Any = None,
    stroke_min: Any = None,
    progress: bool | None = None,
    stroke_zero: Any = "straight",
    certify: bool = True,
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target wants.

    It may be called from several threads at once, as all functions may: what they share is built
    once and not changed, and each solves in memory of its own. Their linear algebra takes turns, so
    that processes are faster.

    Parameters
    ----------
    arm : Arm
    target : Target, or several to be met together
    scene : Scene
        The effects enabled; the bare arm unless given.
    tension_max, tension_min : float, or one for each tendon
        Bounds [N]; infinite and 0 unless given.
    total_pull : float
        The most that all tendons together may pull [N]; no limit unless given.
    norm : "2", "1" or "inf"
        What effort is: root of the sum of squares, sum, or largest tension.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length (angles: rad).
    starts : int
        How many initial guesses are tried, as far as so many differ. Unless given, 14 at most, and
        fewer once enough of them led to the same optimum, which is no proof that it is the best. If
        these miss the target, 8 more, the nearest of several hundred settled shapes under tensions
        sampled over the limits; of a given number, half are such shapes.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene: the search begins
        at its optimum, which takes a tenth of the time. Where that fails all starts are tried.
        Where the tensions do not go over into each other, as where a target passes the arm's axis,
        `outcome` says that the plan left the branch. Where contacts have friction it is the plan
        that the arm moves from in a straight line of tensions, against friction, which may have
        been 0 there; unless given, from the least tensions, where the arm has to touch nothing.
        Such plans are for places and poses.
    time_limit : float
        How long the call may take [s], with shape, certificate and outcome. The search then returns
        the best plan so far. The certificate has what is left of the limit, and at least GRACE, 1
        s. In contact the search ends early by about the time that the arm takes to settle.
        `outcome` says if the limit ended the search, or came before the certificate was complete.
        Setting up the first plan for an arm and a scene is not cut short.
    stability_margin : float
        The least stability of the shape under its loads that is accepted, 0 to 1: the least
        eigenvalue of the scaled Hessian of the energy, which is 1 for an arm at rest and 0 where it
        is about to yield. With 0 the arm has to be stable. Unless given 0.1, where that can be had,
        else the best that is stable, which `outcome` tells as on the brink; 0 where contacts have
        friction.
    compile : bool or "auto"
        Whether to work by machine code, see settle; the plan's shape and certificate are found by
        it too. In a scene as printed, and of curved tendons without loads, only these are.
    obstacles : sequence of Obstacle
        What the arm keeps clear of, all along; see octoplan.model.extensions.obstacles.
    clearance : float
        How far its surface stays from them [m].
    self_clearance : bool
        Whether it stays as far from itself and from the far side of its base plane.
    stroke_max : float, or one for each tendon
        The most that winches take in of tendons from where they are zeroed [m], of slack ones too
        (`Plan.strokes`); no limit unless given.
    stroke_min : float, or one for each tendon
        The least: 0 or below, how far they can pay out; as far as they take in unless given.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.
    stroke_zero : "straight", "at rest", Shape, or lengths (n_tendons,)
        Where winches are zeroed, and strokes count from: at the straight arm without loads, at the
        arm as it stands in the scene without tensions, at a shape, at lengths of tendons [m].
    certify : bool
        Whether to compute shape, certificate and outcome before returning. Pass False in loops that
        need tensions alone; shape and certificate are then computed when they are first read.

    Returns
    -------
    Plan
        Also if the target is not met: then it is the nearest shape found, and `outcome` says how
        far off that is, what holds it, and how many guesses and sampled shapes were tried.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; targets that contradict each other.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene, targets = planned_scene(arm, scene), check_targets(arm, target)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    strokes = (stroke_max, stroke_min, stroke_zero)
    limits = checked_limits(arm, scene, tension_max, tension_min, total_pull, *strokes)
    margin = BRINK if is_loaded(scene) and not rubs(scene) else 0.0
    if stability_margin is not None:
        margin = within("stability_margin", stability_margin, 0.0, 1.0)
    options = checked_options(targets, limits, norm, starts).replace(margin=margin)
    task = PlanningProblem(
        arm,
        targets,
        scene,
        limits,
        options,
        checked_accuracy(accuracy),
        machine_code=checked_compile(compile),
        guesses=starts,
        best_margin=stability_margin is None,
    )
    touches = bool(contacts(scene)) or any(isinstance(each, Hold | Wrap) for each in targets)
    obstacles = check_obstacles(obstacles) + (beside(targets, scene) if touches else ())
    around = surroundings(arm, targets, obstacles, clearance, self_clearance)
    wrap = open_wrap(targets) if touches else None
    if touches:
        check_contact(task, bool(around))
    if near is not None:
        kind("near", near, Plan, "a Plan for the same arm and scene, or None")
        if near.arm != arm or not is_same(near.scene, scene):
            raise InputError("near", "a plan for another arm or scene", "one for the same")
        task = replace(task, targets=with_places_of(targets, near.targets))

    kind("certify", certify, bool, "True or False")

    def planned(targets: tuple[Target, ...], previous: Plan | None) -> Plan:
        leads = previous is not None and previous.mode == "exact"
        return _planned(replace(task, targets=targets), around, previous if leads else near)

    with limited_to(seconds, reserves=certify):
        if contacts(scene) and seconds_left() < np.inf:
            reserve(CONTACT_SHARE * seconds_left())
        if wrap is None:
            result = _held_along(task, around, _planned(task, around, near))
        else:
            result = _held_along(task, around, with_turns(arm, targets, wrap, planned))
        reserve(0.0)
        left = None if seconds is None else max(seconds_left(), GRACE)
    if certify:
        with limited_to(left):
            result.complete()
    return result


def _held_along(task: PlanningProblem, around: Environment, plan: Plan) -> Plan:
    """Return the plan whose targets hold between their stations, too.

    Stations are added where the settled arm violates a target, and the plan is solved again from
    where it is, until there are none.
    """
    for _ in range(CORRECTIONS):
        if plan.stopped or plan.mode != "exact":
            return plan
        refined = plan.targets
        with suppress(OctoplanError, OutOfTime):
            line = partial(_centreline, plan)
            refined = tuple(each.refined_along(line, task.accuracy) for each in plan.targets)
        if refined == plan.targets:
            return plan
        again = replace(task, targets=refined)
        # Without contacts, or beside them: from the plan's tensions, among the same obstacles.
        beside = plan.beside if isinstance(plan, ContactPlan) else plan
        led = None
        if beside is not None:
            free = replace(again, scene=beside.scene)
            led = ObstacleSearch(free, beside.surroundings).led_from(np.ravel(plan.tensions))
        if led is None:
            plan = _planned(again, around, plan)
        else:
            kept = {name: getattr(plan, name) for name in ("starts", "jump", "lost")}
            plan = type(plan).of(again, replace(led, **kept), surroundings=plan.surroundings)
    return plan


def _centreline(plan: Plan) -> Centreline:
    """Return the midline of the shape of a plan."""
    return plan.shape.centreline()


def _planned(task: PlanningProblem, around: Environment, near: Plan | None) -> Plan:
    """Return the plan for a task; raises OutOfTime where it has nothing to show by then."""
    if not contacts(task.scene):
        return Plan.of(task, searched(task, around, near), surroundings=around)
    held = near if isinstance(near, ContactPlan) else None
    # An arm that lies along something may keep clear of it. That has to be tried afresh, unless
    # the one nearby had to lean on something; or where it comes to something on its way from rest.
    question = None if held and not held.beside else beside_contacts(task)
    if question is not None:
        result = searched(*question, held and held.beside)
        plan = ContactPlan.of(task, result, surroundings=question[1])
        with suppress(OctoplanError, OutOfTime):
            if result.stopped or (result.options.mode == "exact" and not plan.shape.contacts):
                return plan
    begin = None if near is None else tuple(np.ravel(near.tensions).tolist())
    load_path = None if begin is None else (*(held.load_path if held else ()), begin)
    return ContactPlan.of(task, ContactSearch(task, load_path).run())


def searched(task: PlanningProblem, around: Environment, near: Answer | None) -> Solution:
    """Return what a plan that is near leads to, or the best from all starts."""
    if near is not None and near.avoidance is not None and near.surroundings == around:
        # Among the same obstacles: by the inequalities of its program, if that keeps clear.
        kept = warm_start(near, task, near.avoidance)
        if kept is not None and not kept.stopped and not kept.jump:
            line = line_of(task, np.ravel(kept.tensions))
            if line is not None and not around.in_the_way(line):
                return kept
    result = None if near is None else warm_start(near, task)
    left = result is None
    if around and not (result and result.stopped):
        led = ObstacleSearch(task, around)
        result = led.run(result)
        left = led.searched
    elif result is None:
        result = Search(task).run()
    if near is not None and left and not result.stopped and result.options.mode == "exact":
        return replace(result, jump=jump(near.tensions, result.tensions))
    return result
