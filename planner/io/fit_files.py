"""Files of calibrations and designs: TOML, with the measured shapes in a CSV file beside it.

Shapes are a line of names, then a shape a line:

    name,session,T_11_N,T_12_N,M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm

`name` and `session` may be left out; a tension for each tendon, by the arm's names of them, or
`length_T_11_mm` or `stroke_T_11_mm` for each, or both; places of markers, by their names, and of
the tip in mm. Cells of a marker that was not seen are empty; a shape without tensions is settled by
its lengths or strokes.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from model import Arm, InputError
from model.errors import FileError
from model.quantities import NotNegative, Positive
from planner.fit.design import Design, design
from planner.fit.making import Making, Objective, Reach
from planner.fit.measured import Measured
from planner.fit.unknowns import Unknown
from planner.io.codec import Table, in_si, quantity, value_of
from planner.io.files import bytes_of, read_toml
from planner.io.mistakes import checked, located, made
from planner.io.object_tables import VECTOR, ObjectiveTable, TargetTable
from planner.io.scene_file import scene_beside, written_question
from planner.io.scene_tables import SceneKey
from planner.io.tables import Accuracy, table

_UNKNOWNS = """
[[unknowns]]
key = "arm.E_kPa"
lower = 50.0
upper = 500.0"""
_SUCH = f'\n\nscene = "scene.toml"\nmeasured = "shapes.csv"{_UNKNOWNS}'
_DESIGN = f"""

scene = "scene.toml"
[[tasks]]
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]{_UNKNOWNS.replace("E_kPa", "radius_mm[1]")}"""


MakingTable: Any = table(Making)
ReachTable: Any = table(Reach, tag="reach")
UnknownTable: Any = table(Unknown)


class PointTable(Table, frozen=True):
    """A marker on the arm, by its name in the columns of the measured shapes."""

    name: str
    s_mm: Annotated[NotNegative, quantity("arc length from the base", "mm")]
    offset_mm: Annotated[VECTOR, quantity("from the midline in the local frame t, n, b", "mm")] = (
        0.0,
        0.0,
        0.0,
    )


class CalibrationFile(Table, frozen=True):
    """A calibration file: a scene, measured shapes, and what is unknown."""

    scene: SceneKey
    measured: Annotated[str, Meta(description="a CSV file of shapes, from this file's folder")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    points: Annotated[tuple[PointTable, ...], Meta(description="the markers")] = ()
    std_mm: Annotated[Positive, quantity("standard deviation of places", "mm")] = 1.0
    length_std_mm: Annotated[
        Positive | None, quantity("of lengths and strokes; std_mm unless given", "mm")
    ] = None
    tension_std: Annotated[NotNegative, quantity("standard deviation of tensions", "N")] = 0.0
    absolute_std: Annotated[bool, Meta(description="whether that holds as it is")] = False
    loss: Annotated[
        Literal["linear", "huber", "soft_l1", "cauchy"], Meta(description="robust unless linear")
    ] = "linear"
    starts: Annotated[int, Meta(ge=1, le=1000, description="how many fits begin")] = 1
    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-5


class DesignFile(Table, frozen=True):
    """A design file: a scene, tasks, and what of the arm is unknown."""

    scene: SceneKey
    tasks: Annotated[tuple[TargetTable, ...], Meta(min_length=1, description="a target each")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    making: MakingTable = MakingTable()
    objective: Annotated[
        ObjectiveTable | ReachTable | None,
        Meta(description="what is best while all tasks are met; the least effort unless given"),
    ] = None


def load_asked(path: str | Path) -> dict[str, Any]:
    """Return what a calibration file asks, as the arguments of calibrate.

    Raises FileError with the file, the key and what is allowed.
    """
    path = Path(path)
    name, needed = str(path), {"unknowns": f"a calibration file is such as {_SUCH}"}
    file = checked(read_toml(path)[0], CalibrationFile, name, needed)
    with scene_beside(file.scene, path) as (scene, scene_name, _):
        question = written_question(scene, scene_name)
    names = [point.name for point in file.points]
    if len(set(names)) < len(names):
        raise FileError(name, "points", f"got {', '.join(names)}; allowed is each name once")
    stds = {"std": in_si(file.std_mm, "mm"), "tension_std": file.tension_std}
    if file.length_std_mm is not None:
        stds["length_std"] = in_si(file.length_std_mm, "mm")
    return {
        "arm": question.arm,
        "scene": question.scene,
        "measured": load_shapes(path.parent / file.measured, question.arm, file.points, **stds),
        "unknowns": _unknowns(file.unknowns, name),
        **{key: getattr(file, key) for key in ("loss", "absolute_std", "starts", "accuracy")},
    }


def run_design(path: str | Path) -> Design:
    """Return the design that a file asks for; FileError with the file and the key."""
    path = Path(path)
    name, needed = str(path), {"tasks": f"a design file is such as {_DESIGN}"}
    file = checked(read_toml(path)[0], DesignFile, name, needed)
    with scene_beside(file.scene, path) as (scene, scene_name, _):
        question = written_question(scene, scene_name)
    if question.options.get("tension_min") or question.options.get("total_pull"):
        text = "got tension_min or total_pull, allowed is tension_max alone in a design"
        raise FileError(name, "limits", text)
    unknowns, most = _unknowns(file.unknowns, name), question.options.get("tension_max", math.inf)

    with located(name, ""):
        objective: Objective = "effort" if file.objective is None else value_of(file.objective)
        tasks, making = [value_of(item) for item in file.tasks], value_of(file.making)
        arguments = question.arm, tasks, unknowns, question.scene, most
        return design(*arguments, making=making, objective=objective)


def _unknowns(tables: Sequence[Any], name: str) -> tuple[Unknown, ...]:
    return tuple(made(name, f"unknowns[{i}]", value_of, each) for i, each in enumerate(tables))


def load_shapes(
    path: str | Path, arm: Arm, points: Sequence[PointTable] = (), **stds: float
) -> tuple[Measured, ...]:
    """Return the shapes of a CSV file, of such standard deviations as Measured has.

    FileError with the row and the column for what is wrong.
    """
    name = str(path)
    text = bytes_of(Path(path), lambda: "a CSV file of shapes is wanted")
    lines = csv.reader(text.decode("utf-8-sig", errors="replace").splitlines())
    header = [cell.strip() for cell in next(lines, [])]
    # By argument of Measured, and by marker.
    columns = {"tensions": [f"{tendon}_N" for tendon in arm.tendon_names], "tip": _place("tip")}
    for key in ("length", "stroke"):
        columns[f"{key}s"] = [f"{key}_{tendon}_mm" for tendon in arm.tendon_names]
    places = [_place(point.name) for point in points]
    known = ["name", "session", *chain(*columns.values()), *chain(*places)]
    for column in header:
        if column not in known or header.count(column) > 1:
            allowed = f"columns, each once, of {', '.join(known)}"
            raise FileError(name, "line 1", f"got {column!r}, allowed are {allowed}")
    drives = [columns[key] for key in ("tensions", "lengths", "strokes")]
    for column in chain(*([each for each in drives if {*each} & {*header}] or drives[:1])):
        if column not in header:
            raise FileError(name, "line 1", f"missing column {column}")
    result = []
    for number, row in enumerate(lines, 2):
        where = f"line {number}"
        if len(row) not in (0, len(header)):
            raise FileError(name, where, f"{len(row)} cells; the header has {len(header)}")
        cells = dict(zip(header, map(str.strip, row), strict=False))
        if not any(row):
            continue
        with located(name, where):
            values: dict[str, Any] = {key: _values(each, cells) for key, each in columns.items()}
            seen = [
                (in_si(point.s_mm, "mm"), in_si(point.offset_mm, "mm"), _values(place, cells))
                for point, place in zip(points, places, strict=True)
            ]
            told = {"name": cells.get("name") or where, "session": cells.get("session", "")}
            result.append(Measured(points=seen, **stds, **told, **values))  # type: ignore[arg-type]
    if not result:
        raise FileError(name, "", "no shapes; a line of names, then a shape a line")
    return tuple(result)


def _place(point: str) -> list[str]:
    """Return the columns of the place of a marker."""
    return [f"{point}_{axis}_mm" for axis in "xyz"]


def _values(columns: list[str], cells: dict[str, str]) -> list[float] | None:
    """Return what cells hold, in SI units; None where they are empty."""
    if not any(cells.get(column) for column in columns):
        return None
    result = []
    for column in columns:
        try:
            value = float(cells.get(column, ""))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            allowed = "a number; leave all cells of a marker that was not seen empty"
            raise InputError(column, cells.get(column, ""), allowed)
        result.append(in_si(value, "mm" if column.endswith("_mm") else "N"))
    return result
