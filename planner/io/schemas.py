"""JSON Schemas of files and of what commands print: generated from the tables and records."""

from __future__ import annotations

from typing import Any

import msgspec

from planner.io.fit_files import CalibrationFile, DesignFile
from planner.io.records import (
    EffectsRecord,
    ExportRecord,
    ShapeRecord,
    StiffnessRecord,
    SweepRecord,
    TrajectoryRecord,
)
from planner.io.saved_records import CalibrationRecord, DesignRecord, PlanRecord
from planner.io.scene_tables import SceneTable

_DIALECT = "https://json-schema.org/draft/2020-12/schema"

RECORDS: dict[str, type[msgspec.Struct]] = {
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
"""The records by the commands that print them with --json."""

FILES: dict[str, type[msgspec.Struct]] = {
    "scene": SceneTable,
    "calibration-file": CalibrationFile,
    "design-file": DesignFile,
}
"""The files that are read."""

SCHEMAS = ("scene", *RECORDS, *(name for name in FILES if name != "scene"))


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scene file: keys, types and ranges.

    What depends on several keys, such as a place beyond the arm's tip, only `load` knows.
    """
    return schema_of("scene")


def schema_of(what: str) -> dict[str, Any]:
    """Return the JSON Schema of files ("scene"), or of a command's JSON, by its name."""
    title = f"octoplan {what}" if what in FILES else f"octoplan {what} --json"
    schema = msgspec.json.schema({**FILES, **RECORDS}[what])
    return {"$schema": _DIALECT, "title": title, **schema}
