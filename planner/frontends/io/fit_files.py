"""Calibration and design files: TOML, with measured shapes in a CSV file beside a calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from octoplan.model.support.errors import FileError
from octoplan.model.support.value import NotNegative, Positive
from octoplan.planner.extensions.fit.design import design
from octoplan.planner.extensions.fit.designed import Design
from octoplan.planner.extensions.fit.manufacturing import ManufacturingLimits, Objective, Reach
from octoplan.planner.extensions.fit.unknowns import Unknown
from octoplan.planner.frontends.io.codec import Table, arguments_of, quantity, value_of
from octoplan.planner.frontends.io.csv_files import MarkerColumns, load_shapes
from octoplan.planner.frontends.io.files import path_of, read_toml
from octoplan.planner.frontends.io.mistakes import build_at, checked, error_context
from octoplan.planner.frontends.io.object_tables import ObjectiveTable, TargetTable
from octoplan.planner.frontends.io.scene_file import SceneFile, load_decoded, scene_beside
from octoplan.planner.frontends.io.scene_tables import SceneKey
from octoplan.planner.frontends.io.tables import Accuracy, table
from octoplan.planner.limits import Limits

# Arguments of `calibrate` that a file has under their names.
_OPTIONS = ("loss", "absolute_std", "starts", "accuracy", "tendon_EA", "tendon_outside")
ManufacturingTable: Any = table(ManufacturingLimits)
ReachTable: Any = table(Reach, tag="reach")
UnknownTable: Any = table(Unknown)


class CalibrationFile(Table, frozen=True):
    """A calibration file: a scene, measured shapes and unknown parameters."""

    scene: SceneKey
    measured: Annotated[str, Meta(description="a CSV file of shapes, from this file's folder")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    points: Annotated[tuple[MarkerColumns, ...], Meta(description="the markers")] = ()
    std_mm: Annotated[Positive | None, quantity("standard deviation of places", "mm")] = None
    length_std_mm: Annotated[
        Positive | None, quantity("of lengths and strokes; std_mm by default", "mm")
    ] = None
    tension_std: Annotated[NotNegative, quantity("standard deviation of tensions", "N")] = 0.0
    tendon_EA: Annotated[
        Positive | None, quantity("stiffness of the tendons; inextensible by default", "N")
    ] = None
    tendon_outside_mm: Annotated[
        NotNegative, quantity("of each tendon, from winch to base, also stretches", "mm")
    ] = 0.0
    absolute_std: Annotated[
        bool, Meta(description="whether standard deviations are used without scaling")
    ] = False
    loss: Annotated[
        Literal["linear", "huber", "soft_l1", "cauchy"], Meta(description="robust unless linear")
    ] = "linear"
    starts: Annotated[
        Annotated[int, Meta(ge=1, le=1000)] | None,
        Meta(description="number of initial guesses; 1 by default, more if shapes are missed"),
    ] = None
    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-5


class DesignFile(Table, frozen=True):
    """A design file: a scene, tasks and unknown parameters of the arm."""

    scene: SceneKey
    tasks: Annotated[tuple[TargetTable, ...], Meta(min_length=1, description="a target each")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    manufacturing: ManufacturingTable = ManufacturingTable()
    objective: Annotated[
        ObjectiveTable | ReachTable | None,
        Meta(description="objective subject to all tasks; least effort by default"),
    ] = None


def load_asked(path: str | Path) -> dict[str, Any]:
    """Return the contents of a calibration file as the arguments of calibrate.

    Raises FileError with the file, the key and the allowed values.
    """
    path = path_of(path)
    name = str(path)
    file, question, unknowns = _read(path, CalibrationFile, "unknowns", "calibrate")
    names = [point.name for point in file.points]
    if len(set(names)) < len(names):
        raise FileError(name, "points", "must have distinct names", ", ".join(names))
    values = arguments_of(file)
    stds = {key: values[key] for key in ("std", "length_std", "tension_std")}
    return {
        "arm": question.arm,
        "scene": question.scene,
        "measured": load_shapes(path.parent / file.measured, question.arm, file.points, **stds),
        "unknowns": unknowns,
        **{key: values[key] for key in _OPTIONS},
    }


def run_design(path: str | Path) -> Design:
    """Return the design for a file; raise FileError with the file and the key."""
    name = str(path)
    file, question, unknowns = _read(path_of(path), DesignFile, "tasks", "design")
    limits: Limits = question.options.get("limits", Limits())
    if limits != Limits(limits.tension_max):
        raise FileError(name, "limits", "must be tension_max alone in a design file")
    with error_context(name, ""):
        objective: Objective = "effort" if file.objective is None else value_of(file.objective)
        tasks = [value_of(item) for item in file.tasks]
        return design(
            question.arm,
            tasks,
            unknowns,
            scene=question.scene,
            tension_max=limits.tension_max,
            manufacturing=value_of(file.manufacturing),
            objective=objective,
        )


def _read(path: Path, kind: Any, needed: str, command: str) -> tuple[Any, SceneFile, list[Unknown]]:
    """Return the contents of a file as a table of a kind, the scene and the unknowns."""
    name = str(path)
    file = checked(read_toml(path)[0], kind, name, needed, command)
    with scene_beside(file.scene, path) as (scene, scene_name, _):
        question = load_decoded(scene, scene_name)
    tables = enumerate(file.unknowns)
    return file, question, [build_at(name, f"unknowns[{i}]", value_of, each) for i, each in tables]
