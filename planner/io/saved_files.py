"""Plans and calibrations that are loaded from files: checked as if they were asked afresh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import Arm, InputError, Scene
from model.checks import not_negative
from model.errors import FileError
from model.loads import check_loads, contacts
from model.mesh_refinement import FINEST, checked_accuracy
from planner.avoidance.asked import Surroundings, surroundings
from planner.avoidance.rows import Avoidance
from planner.fit.calibration import Calibration
from planner.fit.fitted import Start
from planner.fit.least_squares import LOSSES, Weights
from planner.fit.measured import Measured
from planner.fit.unknowns import Unknown
from planner.io.derived import made_from
from planner.io.files import read_file, why
from planner.io.mistakes import mistake, shown
from planner.io.plain import value
from planner.io.saved_records import AnswerRecord, FitRecord, QuestionRecord
from planner.plan import HeldPlan, Plan
from planner.program.limits import Limits
from planner.program.problem import build
from planner.program.statement import Statement
from planner.question import check_planned, check_targets, checked_margin
from planner.solve.search_result import SearchResult
from planner.solve.task import Task
from planner.targets.base import Target
from planner.tendon_lengths import zeroed_at

R = TypeVar("R")
# The number at the end of `schema` of what is written, and the earliest that is read.
_VERSION = 1


class SavedPlan(msgspec.Struct):
    """What a plan is loaded from; see planner.io.saved_records."""

    question: QuestionRecord
    answer: AnswerRecord


class SavedCalibration(msgspec.Struct):
    """What a calibration is loaded from; see planner.io.saved_records."""

    question: dict[str, Any]
    fit: FitRecord


def _record(path: Path, kind: type[R], what: str) -> R:
    """Return what a saved file of a kind holds; FileError for others, with what to do."""
    name = str(path)
    try:
        text = read_file(path)
    except (OSError, ValueError) as reason:
        raise FileError(name, "", f"{why(reason)}; a {what} that was saved is wanted") from None
    try:
        table = msgspec.json.decode(text)
    except (msgspec.DecodeError, ValueError, RecursionError) as reason:
        raise FileError(name, "", f"this is not valid JSON: {reason}") from None
    _check_version(table, name, what)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, table, kind) from None


def _check_version(table: Any, name: str, what: str) -> None:
    if not isinstance(table, dict):
        raise FileError(name, "the file", f"got {shown(table)}, allowed is a {what} that was saved")
    wanted, found = f"octoplan {what} {_VERSION}", table.get("schema")
    if found == wanted:
        return
    if found is None:
        raise FileError(name, "schema", f'missing; a saved {what} has schema = "{wanted}"')
    told = f"got {shown(found)}, allowed is one of {wanted}"
    if isinstance(found, str) and found.startswith(f"octoplan {what} "):
        told += "; another version of octoplan wrote it: load it there, or find it again here"
    raise FileError(name, "schema", told)


def load_plan(path: str | Path) -> Plan:
    """Return the plan that `Plan.save` or `octoplan plan --json` wrote.

    It is equal to the one that was saved. Only question, tensions and multipliers are read:
    shape, certificate and outcome are worked out anew.

    Raises
    ------
    FileError
        With the file and the place, for what cannot be read or is not a plan.
    """
    name = str(path)
    record, within = _record(Path(path), SavedPlan, "plan"), _Within(name)
    task = _task(within, record)
    found = _found(within, record.answer, task.arm)
    _check_statement(within, record.answer, task.limits)
    avoidance = None
    if record.answer.avoidance is not None:
        rows = value(record.answer.avoidance, name, "answer.avoidance")
        avoidance = _kind(rows, Avoidance, name, "answer.avoidance")
    around = _surroundings(within, record.question, task.arm, task.targets)
    more: dict[str, Any] = {"surroundings": around, "avoidance": avoidance}
    if contacts(task.scene):
        plan: Plan = HeldPlan.of(task, found, load_path=found.load_path, **more)
    else:
        plan = Plan.of(task, found, **more)
    _check_multipliers(plan, name)
    return plan


class _Within:
    """Calls checks and tells what they find wrong as errors of a file."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, where: str, build: Callable[[], R]) -> R:
        try:
            return build()
        except InputError as reason:
            raise FileError.of(reason, self.name, where) from None


def _task(within: _Within, record: SavedPlan) -> Task:
    """Return what was asked."""
    name, question, own = within.name, record.question, record.question.limits
    arm = _kind(value(question.arm, name, "question.arm"), Arm, name, "question.arm")
    scene = _kind(value(question.scene, name, "question.scene"), Scene, name, "question.scene")
    found = value(question.targets, name, "question.targets")
    within("question.scene", lambda: check_loads(arm, scene, contact=True))
    given = made_from(Limits, own)
    least, most = given.strokes or (None, None)
    limits = within(
        "question.limits",
        lambda: Limits.of(arm, given.upper, given.lower, given.total).with_strokes(
            arm, most, least
        ),
    )
    within("question.scene", lambda: check_planned(scene))
    if given.stroke_zero is not None:
        lengths = within("question.limits", lambda: zeroed_at(arm, scene, given.stroke_zero))
        limits = replace(limits, stroke_zero=lengths)
    targets = within("question.targets", lambda: check_targets(arm, found))
    accuracy = within("question.accuracy", lambda: checked_accuracy(question.accuracy))
    statement = made_from(Statement, record.answer.statement)
    return Task(arm, targets, scene, limits, statement, accuracy)


def _found(within: _Within, answer: Any, arm: Arm) -> SearchResult:
    """Return what was found."""
    found = made_from(SearchResult, answer)
    tensions = within("answer.tensions", lambda: arm.by_section(arm.flat(found.tensions)))
    for name in ("jump", "lost"):
        within(f"answer.{name}", partial(not_negative, name, getattr(found, name)))
    for i, T in enumerate(found.load_path):
        within(f"answer.load_path[{i}]", partial(arm.flat, T))
    return replace(found, tensions=tensions)


def _surroundings(
    within: _Within, question: QuestionRecord, arm: Arm, targets: tuple[Target, ...]
) -> Surroundings:
    found = value(question.obstacles, within.name, "question.obstacles")
    rest = (question.clearance, question.self_clearance)
    return within("question.obstacles", lambda: surroundings(arm, targets, found, *rest))


def _check_statement(within: _Within, answer: Any, limits: Limits) -> None:
    stated = answer.statement
    within("answer.statement", lambda: checked_margin(stated.margin))
    if stated.modes not in (0, 1):
        told = f"got {stated.modes}, allowed is 0 or 1"
        raise FileError(within.name, "answer.statement.modes", told)
    if not 1 <= stated.refinement <= FINEST:
        told = f"got {stated.refinement}, allowed is a whole number from 1 to {FINEST}"
        raise FileError(within.name, "answer.statement.refinement", told)
    if stated.limited != (limits.total is not None):
        told = f"got {shown(stated.limited)}, question.limits.total is {shown(limits.total)}"
        raise FileError(within.name, "answer.statement.limited", told)
    if stated.wound != (limits.strokes is not None):
        told = f"got {shown(stated.wound)}, question.limits has {'no ' * stated.wound}strokes"
        raise FileError(within.name, "answer.statement.wound", told)


def _check_multipliers(plan: Plan, name: str) -> None:
    """Refuse multipliers that are not finite, or not those of the problem; there may be none."""
    sizes = len(plan.lam_x), len(plan.lam_g)
    if any(sizes) and isinstance(plan, HeldPlan):
        if sizes[0] != plan.arm.n_tendons:
            told = f"got {sizes[0]} numbers, allowed are {plan.arm.n_tendons}, or none"
            raise FileError(name, "answer.lam_x", told)
    elif any(sizes):
        problem = build(plan.arm, plan.stated, plan.scene, plan.statement.but(refinement=1))
        wanted = problem.n_free, problem.n_outer
        if sizes != wanted:
            told = "got {} and {} numbers, allowed are {} and {}, or none".format(*sizes, *wanted)
            raise FileError(name, "answer.lam_x and answer.lam_g", told)
    for where, lam in (("answer.lam_x", plan.lam_x), ("answer.lam_g", plan.lam_g)):
        if not np.all(np.isfinite(lam)):
            raise FileError(name, where, "allowed are finite numbers")


def _kind(found: Any, wanted: type[R], name: str, where: str) -> R:
    if not isinstance(found, wanted):
        told = f"got {type(found).__name__}, allowed is {wanted.__name__}"
        raise FileError(name, f"{where}.kind", told)
    return found


def load_calibration(path: str | Path) -> Calibration:
    """Return the calibration that `Calibration.save` or `octoplan calibrate --json` wrote.

    It is equal to the one that was saved; residuals, standard errors and outcome are worked out
    anew. Raises FileError for what cannot be read or is none.
    """
    name = str(path)
    record = _record(Path(path), SavedCalibration, "calibration")
    asked, fit = record.question, record.fit
    try:
        arm, scene = (value(asked[key], name, f"question.{key}") for key in ("arm", "scene"))
        if not (isinstance(arm, Arm) and isinstance(scene, Scene) and fit.loss in LOSSES):
            raise FileError(name, "question", "no arm, no scene or no loss function")
        shapes = [Measured(**own).checked(arm, own["name"]) for own in asked["measured"]]
        unknowns = tuple(Unknown(**_tupled(own)) for own in asked["unknowns"])
        found = Calibration(
            arm,
            scene,
            tuple(shapes),
            unknowns,
            tuple(float(x) for x in fit.values),
            fit.noise,
            Weights(fit.loss, fit.absolute_std),  # type: ignore[arg-type]
            fit.refinement,
            fit.error,
            tuple(_begun(own) for own in fit.starts),
            tuple(fit.astray),
            tuple((name, why) for name, why in fit.left_out),
            fit.stopped,
            stages=fit.stages,
        )
        if len(found.values) != len(unknowns) or not np.all(np.isfinite(found.values)):
            raise FileError(name, "fit.values", f"{len(unknowns)} finite numbers are needed")
        found.parameters  # noqa: B018  (checks keys and sessions)
    except InputError as reason:
        raise reason if isinstance(reason, FileError) else FileError.of(reason, name, "") from None
    except (TypeError, KeyError, AttributeError) as reason:
        raise FileError(name, "question", f"not what a calibration holds: {reason}") from None
    return found


def _tupled(table: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(own) if isinstance(own, list) else own for key, own in table.items()}


def _begun(table: dict[str, Any]) -> Start:
    own = _tupled(table)
    return Start(own["values"], own["found"], float(own["misfit"]), own["why"])
