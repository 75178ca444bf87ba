"""Load plans and calibrations from files, with the same checks as new input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.lengths.winches import PLAIN_WINCHES
from octoplan.model.forward import checked_accuracy
from octoplan.model.support.checks import finite_array, not_negative, positive, within
from octoplan.model.support.errors import FileError
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.model.support.progress import with_progress
from octoplan.planner.extensions.avoidance.surroundings import surroundings
from octoplan.planner.extensions.base_joints.placement import placed
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.frontends.io.codec import read, value_of
from octoplan.planner.frontends.io.files import path_of, read_json
from octoplan.planner.frontends.io.mistakes import build_at, checked, error_context
from octoplan.planner.frontends.io.records import schema_name
from octoplan.planner.frontends.io.saved_records import (
    AnswerRecord,
    CalibrationQuestion,
    CalibrationRecord,
    FitRecord,
    PlanRecord,
    QuestionRecord,
)
from octoplan.planner.limits import checked_limits
from octoplan.planner.plan import strategy_of
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem, check_targets, planned_scene


class SavedPlan(msgspec.Struct):
    """The part of a plan file that is loaded; see octoplan.planner.frontends.io.saved_records."""

    question: QuestionRecord
    answer: AnswerRecord


class SavedCalibration(msgspec.Struct):
    """The part of a calibration file that is loaded; see saved_records."""

    question: CalibrationQuestion
    fit: FitRecord


@with_progress
def load_plan(
    path: str | Path, *, time_limit: float | None = None, progress: bool | None = None
) -> Plan:
    """Return the plan in a file written by `Plan.save` or `octoplan plan --json`.

    The plan is equal to the saved one. Problem, tensions and multipliers are read; shape,
    certificate and outcome are computed again, for at most `time_limit` [s]. The outcome reports if
    the limit was reached. `progress`: see `plan`.

    Raises
    ------
    FileError
        With file and place, if the file cannot be read or is not a plan.
    """
    name = str(path)
    saved = checked(read_json(path_of(path), schema_name(PlanRecord)), SavedPlan, name)
    question = saved.question
    answer = saved.answer
    problem = _task(name, question, answer)
    result = build_at(name, "answer", value_of, answer)
    flat = build_at(name, "answer.tensions", problem.arm.flat, result.tensions)
    result = replace(result, tensions=problem.arm.by_section(flat))
    for key in ("jump", "lost"):
        build_at(name, f"answer.{key}", not_negative, key, getattr(result, key))
    for i, T in enumerate(result.load_path):
        build_at(name, f"answer.load_path[{i}]", problem.arm.flat, T)
    obstacles = read(Any, question.obstacles)
    around = build_at(
        name,
        "question.obstacles",
        surroundings,
        problem.arm,
        problem.targets,
        obstacles,
        question.clearance,
        question.self_clearance,
    )
    problem = replace(problem, environment=around)
    if question.base is not None:
        problem = build_at(name, "question.base", placed, problem, value_of(question.base))
        build_at(name, "answer.base", finite_array, "base", result.base, (2,))
    plan = strategy_of(problem, has_obstacles=bool(around)).plan_of(problem, result)
    _check_multipliers(plan, name)
    with limited_to(None if time_limit is None else positive("time_limit", time_limit)):
        plan.complete()
    return plan


def _task(name: str, question: QuestionRecord, answer: Any) -> PlanningProblem:
    """Return the planning problem, with the checks of `plan`."""
    arm: Arm = build_at(name, "question.arm", value_of, question.arm)
    scene = build_at(name, "question.scene", value_of, question.scene)
    build_at(name, "question.scene", planned_scene, arm, scene)
    with error_context(name, "question.limits"):
        limits = checked_limits(arm, scene, **value_of(question.limits).keywords)
    targets = build_at(name, "question.targets", check_targets, arm, read(Any, question.targets))
    accuracy = build_at(name, "question.accuracy", checked_accuracy, question.accuracy)
    options = value_of(answer.options)
    build_at(name, "answer.options", within, "stability_margin", options.margin, 0.0, 1.0)
    return PlanningProblem(arm, targets, scene, limits, options, accuracy)


def _check_multipliers(plan: Plan, name: str) -> None:
    """Raise FileError for multipliers that are not finite or of the wrong number."""
    lam_x = plan.solution.lam_x
    lam_g = plan.solution.lam_g
    sizes = len(lam_x), len(lam_g)
    wanted = plan.multiplier_counts() if any(sizes) else sizes
    if sizes != wanted:
        rule = "must be empty or have {} and {} numbers, not {} and {}".format(*wanted, *sizes)
        raise FileError(name, "answer.lam_x and answer.lam_g", rule)
    for where, lam in (("answer.lam_x", lam_x), ("answer.lam_g", lam_g)):
        if not np.all(np.isfinite(lam)):
            raise FileError(name, where, "must be finite numbers")


def load_calibration(path: str | Path) -> Calibration:
    """Return the calibration in a file by `Calibration.save` or `octoplan calibrate --json`.

    The calibration is equal to the saved one; residuals, standard errors and outcome are computed
    again. Raises FileError if the file cannot be read or is not a calibration.
    """
    name = str(path)
    saved = checked(
        read_json(path_of(path), schema_name(CalibrationRecord)), SavedCalibration, name
    )
    question = saved.question
    fit = saved.fit
    with error_context(name, "question"):
        arm = value_of(question.arm)
        scene = value_of(question.scene)
        unknowns = tuple(map(value_of, question.unknowns))
        shapes = tuple(item.checked(arm, item.name) for item in map(value_of, question.measured))
        winches = PLAIN_WINCHES
        if not isinstance(question.winches, msgspec.UnsetType):
            winches = value_of(question.winches)
    if len(fit.values) != len(unknowns) or not np.all(np.isfinite(fit.values)):
        rule = f"must be {len(unknowns)} finite numbers"
        raise FileError(name, "fit.values", rule)
    kept = {key: getattr(fit, key) for key in fit.__struct_fields__}
    values = {key: read(Any, x) for key, x in kept.items() if x is not msgspec.UNSET}
    with error_context(name, "fit"):
        result = Calibration(arm, scene, shapes, unknowns, given_winches=winches, **values)
        result.parameters  # noqa: B018  (checks keys and sessions)
    return result
