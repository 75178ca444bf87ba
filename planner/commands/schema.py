"""octoplan schema: the JSON Schema of scene files, and of what the commands print with --json."""

from __future__ import annotations

import argparse
from typing import Any

import msgspec

from planner.commands.command import OK, Answer, Command
from planner.files import to_json
from planner.records.calibration import CalibrationRecord
from planner.records.design import DesignRecord
from planner.records.effects import EffectsRecord
from planner.records.export import ExportRecord
from planner.records.plan import PlanRecord
from planner.records.shape import ShapeRecord
from planner.records.stiffness import StiffnessRecord
from planner.records.sweep import SweepRecord
from planner.records.trajectory import TrajectoryRecord
from planner.scenes.schema import DIALECT, scene_schema

_RECORDS: dict[str, type[msgspec.Struct]] = {
    "plan": PlanRecord,
    "settle": ShapeRecord,
    "stiffness": StiffnessRecord,
    "effects": EffectsRecord,
    "sweep": SweepRecord,
    "calibrate": CalibrationRecord,
    "design": DesignRecord,
    "export": ExportRecord,
    "trajectory": TrajectoryRecord,
}


def schema_of(what: str) -> dict[str, Any]:
    """Return the JSON Schema of scene files ("scene"), or of a command's JSON, by its name."""
    if what == "scene":
        return scene_schema()
    schema = msgspec.json.schema(_RECORDS[what])
    return {"$schema": DIALECT, "title": f"octoplan {what} --json", **schema}


def add(parser: argparse.ArgumentParser) -> None:
    """Add the choice of a schema."""
    parser.add_argument(
        "what", nargs="?", default="scene", choices=["scene", *_RECORDS], help="scene unless given"
    )


def run(args: argparse.Namespace) -> Answer:
    """Return the schema; it is JSON for people too."""
    return Answer(OK, lambda: to_json(schema_of(args.what)).decode())


COMMAND = Command(
    "schema", "print the JSON Schema of scene files, or of what a command prints", add, run
)
