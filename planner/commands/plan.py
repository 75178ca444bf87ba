"""octoplan plan: the tensions of least effort for a scene's targets."""

from __future__ import annotations

from typing import Any

from model import OctoplanError
from model.time_limit import OutOfTime
from planner import plan as find
from planner.commands.answer import NOT_REACHED, OK, Answer
from planner.commands.options import (
    SceneFile,
    SceneOptions,
    check_plannable,
    plan_arguments,
)
from planner.io.csv_files import plan_csv, shape_csv
from planner.io.saved_records import plan_record
from planner.plan import Plan


def plan(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the tensions of least effort for the scene's target."""
    options = options or SceneOptions()
    question = options.asked(scene)
    check_plannable(question, scene)
    given = (question.arm, question.targets, question.scene)
    result = find(*given, **plan_arguments(question, options))
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: str(result),
        plan_record(result),
        "plan",
        lambda: _draw(result),
        {"plan.csv": lambda: plan_csv(result), "shape.csv": lambda: _shape_csv(result)},
    )


def _shape_csv(result: Plan) -> bytes:
    """Return the shape as CSV, of no lines where the tensions do not settle."""
    try:
        return shape_csv(result.shape)
    except (OctoplanError, OutOfTime):
        return b""


def _draw(result: Plan) -> Any:
    from planner.plots.plan import plot_plan

    return plot_plan(result)
