"""octoplan plan: the tensions of least effort for a scene's targets."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from model import OctoplanError
from model.errors import FileError
from model.time_limit import OutOfTime
from planner.commands.command import (
    NOT_REACHED,
    OK,
    Answer,
    Command,
    add_compiled_options,
    question,
)
from planner.io.csv_files import plan_csv, shape_csv
from planner.io.saved_records import plan_record
from planner.io.scene_file import Question
from planner.plan import Plan, plan

_TARGET = 'a [target] table, such as [target] type = "tip-position", position_mm = [250, 0, -150]'
_LIMITS = "a [limits] table, such as [limits] tension_max = 20.0 (N, each tendon)"


def run(args: argparse.Namespace) -> Answer:
    """Plan for the scene's targets."""
    asked, accuracy = question(args)
    check_asked(asked, args.scene)
    options = {**asked.options, "time_limit": args.time_limit, "compile": asked.compile}
    found = plan(asked.arm, asked.targets, asked.scene, accuracy=accuracy, **options)
    return Answer(
        OK if found.certificate.passed else NOT_REACHED,
        lambda: str(found),
        plan_record(found),
        "plan",
        lambda: _draw(found),
        _tables(found) if args.out else {},
    )


def check_asked(asked: Question, name: Path) -> None:
    """Raise FileError for a scene file that asks for no plan."""
    if not asked.targets:
        raise FileError(str(name), "target", f"missing; needed is {_TARGET}")
    if "tension_max" not in asked.options:
        raise FileError(str(name), "limits", f"missing; needed is {_LIMITS}")


def _tables(found: Plan) -> dict[str, bytes]:
    """Return the plan and its shape as CSV, that of no lines where the tensions do not settle."""
    try:
        shape = shape_csv(found.shape)
    except (OctoplanError, OutOfTime):
        shape = b""
    return {"plan.csv": plan_csv(found), "shape.csv": shape}


def _draw(found: Plan) -> Any:
    from planner.plots.plan import plot_plan

    return plot_plan(found)


COMMAND = Command(
    "plan",
    "find the tensions of least effort for the scene's target",
    add_compiled_options,
    run,
)
