"""Files of calibrations and designs: TOML, with the measured shapes in a CSV file beside it.

Shapes are a line of names, then a shape a line:

    name,session,T_11_N,T_12_N,M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm

`name` and `session` may be left out; a tension for each tendon, by the arm's names of them; places
of markers, by their names, and of the tip in mm; `length_T_11_mm` and `stroke_T_11_mm` of all
tendons or none. Cells of a marker that was not seen are empty.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from model import Arm, Scene
from model.errors import FileError
from model.quantities import NotNegative, Positive
from planner.fit.calibrate import calibrate
from planner.fit.calibration import Calibration
from planner.fit.design import design
from planner.fit.designed import Design
from planner.fit.making import Making, Objective, Reach
from planner.fit.measured import Measured
from planner.fit.unknowns import MM, Unknown
from planner.io.annotations import quantity
from planner.io.arm_tables import VECTOR
from planner.io.codec import Table, in_si, value_of
from planner.io.mistakes import told_in
from planner.io.object_tables import ObjectiveTable, TargetTable
from planner.io.scene_file import converted, decoded, scene_beside, text_of
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


@dataclass(frozen=True)
class Asked:
    """What a calibration file asks: the arguments of calibrate."""

    arm: Arm
    scene: Scene
    measured: tuple[Measured, ...]
    unknowns: tuple[Unknown, ...]
    options: dict[str, Any]

    def run(self) -> Calibration:
        """Calibrate."""
        return calibrate(self.arm, self.scene, self.measured, self.unknowns, **self.options)


def load_asked(path: str | Path) -> Asked:
    """Return what a calibration file asks; FileError with the file, the key and what is allowed."""
    path = Path(path)
    name, needed = str(path), f"a calibration file is such as {_SUCH}"
    file = converted(decoded(text_of(path), name), CalibrationFile, "unknowns", name, needed)
    question = scene_beside(file.scene, path)
    names = [point.name for point in file.points]
    if len(set(names)) < len(names):
        raise FileError(name, "points", f"got {', '.join(names)}; allowed is each name once")
    shapes = load_shapes(
        path.parent / file.measured, question.arm, file.points, in_si(file.std_mm, "mm")
    )
    kept = ("loss", "absolute_std", "starts", "accuracy")
    options = {key: getattr(file, key) for key in kept}
    return Asked(question.arm, question.scene, shapes, _unknowns(file.unknowns, name), options)


def run_design(path: str | Path) -> Design:
    """Return the design that a file asks for; FileError with the file and the key."""
    path = Path(path)
    name, needed = str(path), f"a design file is such as {_DESIGN}"
    file = converted(decoded(text_of(path), name), DesignFile, "tasks", name, needed)
    question = scene_beside(file.scene, path)
    if question.options.get("tension_min") or question.options.get("total_pull"):
        text = "got tension_min or total_pull, allowed is tension_max alone in a design"
        raise FileError(name, "limits", text)
    unknowns, most = _unknowns(file.unknowns, name), question.options.get("tension_max", math.inf)

    with told_in(name, ""):
        objective: Objective = "effort" if file.objective is None else value_of(file.objective)
        tasks, making = [value_of(item) for item in file.tasks], value_of(file.making)
        arguments = question.arm, tasks, unknowns, question.scene, most
        return design(*arguments, making=making, objective=objective)


def _unknowns(tables: Sequence[Any], name: str) -> tuple[Unknown, ...]:
    result = []
    for i, item in enumerate(tables):
        with told_in(name, f"unknowns[{i}]"):
            result.append(value_of(item))
    return tuple(result)


def load_shapes(
    path: str | Path, arm: Arm, points: Sequence[PointTable] = (), std: float = 1e-3
) -> tuple[Measured, ...]:
    """Return the shapes of a CSV file; FileError with the row and the column for what is wrong."""
    name = str(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as reason:
        message = getattr(reason, "strerror", None) or str(reason)
        raise FileError(name, "", f"{message.lower()}; a CSV file of shapes is wanted") from None
    reader = csv.reader(text.splitlines())
    header = [cell.strip() for cell in next(reader, [])]
    columns = _Columns(name, arm, points, std, header)
    rows = [(line, row) for line, row in enumerate(reader, 2) if any(row)]
    if not rows:
        raise FileError(name, "", "no shapes; a line of names, then a shape a line")
    result = []
    for line, row in rows:
        with told_in(name, f"line {line}"):
            result.append(columns.shape(line, row))
    return tuple(result)


class _Columns:
    """The columns of a file of shapes, which read its rows."""

    def __init__(
        self, name: str, arm: Arm, points: Sequence[PointTable], std: float, header: list[str]
    ) -> None:
        self.name, self.points, self.std, self.header = name, points, std, header
        tendons = arm.tendon_names
        self.tensions = [f"{tendon}_N" for tendon in tendons]
        self.places = {what: [f"{what}_{x}_mm" for x in "xyz"] for what in self._seen}
        self.runs = {k: [f"{k}_{tendon}_mm" for tendon in tendons] for k in ("length", "stroke")}
        groups = [*self.places.values(), *self.runs.values()]
        names = ["name", "session", *self.tensions, *(item for group in groups for item in group)]
        for column in header:
            if column not in names or header.count(column) > 1:
                allowed = f"columns, each once, of {', '.join(names)}"
                raise FileError(name, "line 1", f"got {column!r}, allowed are {allowed}")
        for column in self.tensions:
            if column not in header:
                raise FileError(name, "line 1", f"missing column {column}")

    @property
    def _seen(self) -> list[str]:
        return [*(point.name for point in self.points), "tip"]

    def shape(self, line: int, row: list[str]) -> Measured:
        """Return the shape of a row."""
        where = f"line {line}"
        if len(row) != len(self.header):
            text = f"{len(row)} cells; the header has {len(self.header)}"
            raise FileError(self.name, where, text)
        cells = dict(zip(self.header, (cell.strip() for cell in row), strict=True))

        def values(columns: list[str], scale: float = MM) -> list[float] | None:
            arguments = [cells.get(column, "") for column in columns]
            pairs = zip(columns, arguments, strict=True)
            return (
                [scale * self._number(where, *item) for item in pairs] if any(arguments) else None
            )

        tensions = values(self.tensions, 1.0)
        if tensions is None:
            raise FileError(self.name, where, "no tensions")
        places = {what: values(columns) for what, columns in self.places.items()}
        points = [(MM * p.s_mm, [MM * x for x in p.offset_mm], places[p.name]) for p in self.points]
        lengths, strokes = map(values, self.runs.values())
        session, name = cells.get("session", ""), cells.get("name") or where
        more = {"lengths": lengths, "strokes": strokes, "session": session, "name": name}
        return Measured(tensions, points, tip=places["tip"], std=self.std, **more)  # type: ignore[arg-type]

    def _number(self, where: str, column: str, cell: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            allowed = "a number; leave all cells of a marker that was not seen empty"
            raise FileError(self.name, f"{where}, {column}", f"got {cell!r}, allowed is {allowed}")
        return value
