"""Plans: the question is checked, then a plan nearby is followed or a search made."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind, not_negative, positive
from model.errors import InputError, OctoplanError
from model.loads import contacts, is_loaded
from model.machine.compiled import Compile, checked_compile
from model.mesh import checked_accuracy
from model.obstacles import check_obstacles
from model.paths import Array
from model.progress import with_progress
from model.scene import Scene
from model.settle import checked_scene
from model.shape import Shape
from model.text import in_notebook, plotted
from model.time_limit import OutOfTime, time_limit
from planner.answer import Answer
from planner.avoidance.around import Around
from planner.avoidance.clear import keeping, line_of
from planner.avoidance.surroundings import Surroundings, surroundings
from planner.contact.grasp import Grip, grips_of
from planner.contact.load_path import from_rest, is_same, rubs, settled_along
from planner.contact.search import ContactSearch, check_contact, check_holds, optimality_of
from planner.contact.wrapping import (
    beside,
    beside_contacts,
    open_wrap,
    with_turns,
    without_contacts,
)
from planner.io.files import to_json, write_named
from planner.io.saved_records import plan_record
from planner.program.problem import Problem
from planner.program.program import STABILITY
from planner.program.statement import Solver
from planner.question import (
    check_compliance_requests,
    check_planned,
    check_targets,
    checked_limits,
    checked_starts,
    stated,
    warn_of_form,
)
from planner.report import plan_summary, plan_text
from planner.solve.search import Search
from planner.solve.task import SearchResult, Task
from planner.solve.warm_start import jump, warm_start
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap
from planner.tendon_lengths import zeroed_at


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
            norm=self.statement.norm,
            accuracy=self.accuracy,
            near=self,
            stability_margin=self.statement.margin,
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

    def __repr__(self) -> str:
        return plan_summary(self)

    def __str__(self) -> str:
        return plan_text(self)

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D with its tendons, tensions and target; see planner.plots.plan."""
        return plotted(self, ax)


@dataclass(frozen=True, eq=False, repr=False)
class HeldPlan(Plan):
    """A plan for an arm in contact; see planner.contact.

    SearchResult has its load path; `shape.snaps` tells where the arm jumps at last. With
    surroundings it is that of an arm which keeps clear of what it may lean on, and optimal among
    these.
    """

    @cached_property
    def shape(self) -> Shape:
        """See Answer.shape: the one to which its load path leads."""
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
    def mirror_images(self) -> tuple[tuple[float, Array], ...]:
        """See Answer.mirror_images: not looked for."""
        return ()

    @property
    def outcome(self) -> str:
        """See Answer.outcome."""
        leans = "It keeps clear of what it may lean on; leaning was not tried."
        return f"{super().outcome} {leans}" if self.beside and self.reached else super().outcome

    def problem(self) -> Problem:
        """See Answer.problem: that of the arm without contacts, where it keeps clear of them."""
        return self.beside.problem() if self.beside else super().problem()

    def _rows(self, name: str) -> Array:
        """See Answer._rows: where it leans stability alone holds beside limits of tensions."""
        if self.beside:
            return super()._rows(name)
        return np.array(self.lam_g[-1:] if name == STABILITY and self.statement.modes else ())

    def _kkt(self) -> float:
        if self.beside:
            return self.beside._kkt()
        return optimality_of(self.task, np.ravel(self.tensions), self.shape, self.load_path)


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
    solver: Solver = "auto",
    form: Any = None,
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
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target wants.

    It may be called from several threads at once, as all functions may: what they share is built
    once and not changed, and each solves in memory of its own. Their linear algebra takes turns, so
    that processes are faster.

    Parameters
    ----------
    target : Target, or several to be met together
    scene : Scene
        The effects enabled; the bare arm unless given.
    tension_max, tension_min : float, or one for each tendon
        [N].
    total_pull : float
        The most that all tendons together may pull [N]; no limit unless given.
    norm : "2", "1" or "inf"
        What effort is: root of the sum of squares, sum, or largest tension.
    solver : "auto", "ipopt" or "fatrop"
        What is to solve the program; "auto" takes ipopt. Where it can be stated in stages from base
        to tip, fatrop may solve it from initial guesses, and ipopt where that fails.
        `Plan.statement` tells what did, and in how many iterations.
    form
        Deprecated: there is one program.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length (angles: rad).
    starts : int
        How many initial guesses are tried, as far as so many differ. Unless given, 14 at most, and
        fewer once enough of them led to the same optimum; that many are no proof.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene: its optimum is
        followed to this target, which is some ten times sooner. Where that fails all starts are
        tried. Where the tensions do not go over into each other, as where a target passes the arm's
        axis, `outcome` says that the plan left the branch. Where contacts have friction it is the
        plan that the arm moves from in a straight line of tensions, against friction, which may
        have been 0 there; unless given, from the least tensions, where the arm has to touch
        nothing. Such plans are for places and poses.
    time_limit : float
        [s]. What is best then is returned, and `outcome` says so; what the first plan for an arm
        and a scene needs to be set up is not cut short.
    stability_margin : float
        The least stability of the shape under its loads that is accepted, 0 to 1: the least
        eigenvalue of the scaled Hessian of the energy, which is 1 for an arm at rest and 0 where it
        is about to yield. With 0 the arm has to be stable. Unless given 0.1, where that can be had,
        else the best that is stable, which `outcome` tells as on the brink; 0 in contact.
    compile : bool or "auto"
        Whether to work by machine code, see settle; the plan's shape and certificate are found by
        it too. In a scene as printed, and of curved tendons without loads, only these are.
    obstacles : sequence of Obstacle
        What the arm keeps clear of, all along; see model.obstacles.
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

    Returns
    -------
    Plan
        Also when the target cannot be met: then it is the nearest attainable shape, and
        `outcome` says how far off it is and what holds it.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; targets that contradict each other.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene, targets = checked_scene(arm, scene, contact=True), check_targets(arm, target)
    check_planned(scene)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    strokes = (stroke_max, stroke_min)
    limits = checked_limits(arm, tension_max, tension_min, total_pull, strokes)
    limits = replace(limits, stroke_zero=zeroed_at(arm, scene, stroke_zero))
    check_compliance_requests(targets, limits)
    warn_of_form(form)
    statement = stated(limits, norm, solver, stability_margin)
    more = checked_accuracy(accuracy), checked_compile(compile), checked_starts(starts)
    task = Task(arm, targets, scene, limits, statement, *more, stability_margin is None)
    if not is_loaded(scene) or contacts(scene):
        task = replace(task, statement=statement.but(margin=stability_margin or 0.0))
    check_holds(targets, scene)
    obstacles = check_obstacles(obstacles) + beside(targets, scene)
    around = surroundings(arm, targets, obstacles, clearance, self_clearance)
    if contacts(scene):
        check_contact(task, bool(around))
    if near is not None:
        _check_near(near, task)
    wrap = open_wrap(targets)
    if wrap is None:
        return _planned(task, around, near, seconds)
    return _with_turns(task, wrap, around, near, seconds)


def _with_turns(
    task: Task, wrap: Wrap, around: Surroundings, near: Plan | None, seconds: float | None
) -> Plan:
    """Return the plan for a wrap whose length is free."""

    def planned(targets: tuple[Target, ...], previous: Plan | None) -> Plan:
        leads = previous is not None and previous.mode == "exact"
        return _planned(replace(task, targets=targets), around, previous if leads else near, None)

    with time_limit(seconds):
        return with_turns(task.arm, task.targets, wrap, planned)


def _planned(task: Task, around: Surroundings, near: Plan | None, seconds: float | None) -> Plan:
    if not contacts(task.scene):
        return Plan.of(task, searched(task, around, near, seconds), surroundings=around)
    with time_limit(seconds):
        return _beside(task, near) or _held(task, near)


def _beside(task: Task, near: Plan | None) -> HeldPlan | None:
    """Return the plan of an arm that lies along something, and keeps clear of it.

    None where the arm has to lean on something, or comes to it on its way from rest.
    """
    leans = isinstance(near, HeldPlan) and not near.beside
    question = None if leans else beside_contacts(task)
    if question is None:
        return None
    result = searched(*question, near.beside if isinstance(near, HeldPlan) else None, None)
    plan = HeldPlan.of(task, result, surroundings=question[1])
    with suppress(OctoplanError, OutOfTime):
        if result.stopped or (result.statement.mode == "exact" and not plan.shape.contacts):
            return plan
    return None


def _held(task: Task, near: Plan | None) -> HeldPlan:
    """Return the plan of an arm in contact."""
    load_path = near.load_path if isinstance(near, HeldPlan) else ()
    begin = None if near is None else (*load_path, tuple(np.ravel(near.tensions).tolist()))
    if begin is None and rubs(task.scene):
        begin = from_rest(task.arm, np.array(task.allowed.lower), task.scene)
    return HeldPlan.of(task, ContactSearch(task, begin).run(None))


def _check_near(near: Plan, task: Task) -> None:
    """Raise InputError for what is no plan for the same arm and scene."""
    kind("near", near, Plan, "a Plan for the same arm and scene, or None")
    if near.arm != task.arm or not is_same(near.scene, task.scene):
        raise InputError("near", "a plan for another arm or scene", "one for the same")


def searched(
    task: Task, around: Surroundings, near: Answer | None, seconds: float | None
) -> SearchResult:
    """Return what a plan that is near leads to, or the best from all starts."""
    if near is None:
        if around:
            return Around(task, around).run(seconds)
        return Search(task).run(seconds)
    with time_limit(seconds):
        kept = _kept_clear(near, task, around)
        if kept is not None:
            return kept
        followed = warm_start(near, task)
        left = not followed
        if around and not (followed and followed.stopped):
            led = Around(task, around)
            result = led.run(seconds, followed)
            left = led.searched
        else:
            result = followed or Search(task).run()
    if not left or result.stopped or result.statement.mode != "exact":
        return result
    return replace(result, jump=jump(near.tensions, result.tensions))


def _kept_clear(near: Answer, task: Task, around: Surroundings) -> SearchResult | None:
    """Return what a plan among the same obstacles leads to by the inequalities of its program.

    None where that does not keep clear, or leaves its branch.
    """
    if near.avoidance is None or near.surroundings != around:
        return None
    result = warm_start(near, keeping(task, near.avoidance))
    if result is None or result.stopped or result.jump:
        return None
    line = line_of(task, np.ravel(result.tensions))
    return result if line is not None and around.keeps(line) else None
