"""Plans that are loaded from files: checked as if they were asked afresh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import Arm, InputError, Scene
from model.errors import FileError
from model.loads import check_loads, contacts
from model.mesh_refinement import FINEST, checked_accuracy
from planner.avoidance.asked import Surroundings, surroundings
from planner.avoidance.rows import Avoidance
from planner.files import read_file, why
from planner.plan import HeldPlan, Plan
from planner.program.limits import Limits
from planner.program.problem import build
from planner.question import check_planned, check_targets, checked_margin
from planner.records.plan import AnswerRecord, PlanRecord, QuestionRecord, StartRecord
from planner.records.values import Number, value
from planner.scenes.mistakes import mistake, shown
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task
from planner.targets.base import Target
from planner.tendon_lengths import zeroed_at

R = TypeVar("R")


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
    record, within = _record(Path(path), name), _Within(name)
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


def _task(within: _Within, record: PlanRecord) -> Task:
    """Return what was asked."""
    name, question, own = within.name, record.question, record.question.limits
    arm = _kind(value(question.arm, name, "question.arm"), Arm, name, "question.arm")
    scene = _kind(value(question.scene, name, "question.scene"), Scene, name, "question.scene")
    found = value(question.targets, name, "question.targets")
    within("question.scene", lambda: check_loads(arm, scene, contact=True))
    upper = _floats(own.upper, name, "question.limits.upper")
    lower = _floats(own.lower, name, "question.limits.lower")
    least, most = (
        _floats(end, name, "question.limits.strokes") if end is not None else None
        for end in own.strokes or (None, None)
    )
    limits = within(
        "question.limits",
        lambda: Limits.of(arm, upper, lower, own.total).with_strokes(arm, most, least),
    )
    within("question.scene", lambda: check_planned(scene))
    if own.stroke_zero is not None:
        zero = _floats(own.stroke_zero, name, "question.limits.stroke_zero")
        lengths = within("question.limits", lambda: zeroed_at(arm, scene, zero))
        limits = replace(limits, stroke_zero=lengths)
    targets = within("question.targets", lambda: check_targets(arm, found))
    accuracy = within("question.accuracy", lambda: checked_accuracy(question.accuracy))
    return Task(arm, targets, scene, limits, record.answer.statement, accuracy)


def _found(within: _Within, answer: AnswerRecord, arm: Arm) -> SearchResult:
    """Return what was found."""
    name = within.name
    tensions = _floats(answer.tensions, name, "answer.tensions")
    paths = [
        (f"answer.load_path[{i}]", _floats(T, name, f"answer.load_path[{i}]"))
        for i, T in enumerate(answer.load_path)
    ]
    return SearchResult(
        answer.statement,
        within("answer.tensions", lambda: arm.by_section(arm.flat(tensions))),
        tuple(_floats(answer.lam_x, name, "answer.lam_x")),
        tuple(_floats(answer.lam_g, name, "answer.lam_g")),
        tuple(_start(start, name, f"answer.starts[{i}]") for i, start in enumerate(answer.starts)),
        answer.stopped,
        answer.jump,
        answer.lost,
        answer.in_the_way,
        tuple(tuple(within(where, partial(arm.flat, T))) for where, T in paths),
    )


def _surroundings(
    within: _Within, question: QuestionRecord, arm: Arm, targets: tuple[Target, ...]
) -> Surroundings:
    found = value(question.obstacles, within.name, "question.obstacles")
    rest = (question.clearance, question.self_clearance)
    return within("question.obstacles", lambda: surroundings(arm, targets, found, *rest))


def _record(path: Path, name: str) -> PlanRecord:
    try:
        text = read_file(path)
    except (OSError, ValueError) as reason:
        raise FileError(name, "", f"{why(reason)}; a plan that was saved is wanted") from None
    try:
        table = msgspec.json.decode(text)
    except (msgspec.DecodeError, ValueError, RecursionError) as reason:
        raise FileError(name, "", f"this is not valid JSON: {reason}") from None
    try:
        return msgspec.convert(table, PlanRecord)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, table, PlanRecord) from None


def _check_statement(within: _Within, answer: AnswerRecord, limits: Limits) -> None:
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
        wanted = problem.n_free, sum(row.size for row in problem.condensed.rows)
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


def _start(start: StartRecord, name: str, where: str) -> Trial:
    objective = _floats([start.objective], name, f"{where}.objective")[0]
    return Trial(objective, start.met, start.iterations)


def _floats(values: list[Number], name: str, where: str) -> list[float]:
    """Return numbers, of which those that are not finite are given by name."""
    for i, given in enumerate(values):
        if isinstance(given, str) and given not in ("inf", "-inf", "nan"):
            told = f'got {shown(given)}, allowed is a number, "inf", "-inf" or "nan"'
            raise FileError(name, f"{where}[{i}]", told)
    return [float(given) for given in values]
