"""CSV files: a line of names that tell units, then numbers line by line.

Plans as winches are driven by, shapes along the arm and motions over time are written; what was
measured, and waypoints, are read. Measured shapes are a shape a line:

    name,session,T_11_N,T_12_N,M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm

`name` and `session` may be left out; a tension for each tendon, by the arm's names of them, or
`length_T_11_mm` or `stroke_T_11_mm` for each, or both; places of markers, by their names, and of
the tip in mm. Cells of a marker that was not seen are empty; a shape without tensions is settled by
its lengths or strokes.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model import Arm, InputError, Shape
from octoplan.model.paths import Array
from octoplan.model.support.checks import kind, within
from octoplan.model.support.errors import FileError
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.frontends.io.codec import in_si, number_in
from octoplan.planner.frontends.io.files import bytes_of, write_named
from octoplan.planner.frontends.io.mistakes import error_context
from octoplan.planner.frontends.io.records import POINTS, of_shape
from octoplan.planner.frontends.io.varied import MarkerTable
from octoplan.planner.targets import TipPosition

_FRAME = [f"{column}_{axis}" for column in "tnb" for axis in "xyz"]
SHAPE_COLUMNS = ("s_m", "x_m", "y_m", "z_m", *_FRAME, "tau_1_m", "xi_1_m", "k_1_m", "q")
PLAN_COLUMNS = ("section", "tendon", "tension_N", "length_mm", "stroke_mm", "state")
WAYPOINT_COLUMNS = ("x_m", "y_m", "z_m")


class MarkerColumns(MarkerTable, frozen=True, kw_only=True):
    """A marker on the arm, by its name in the columns of the measured shapes."""

    name: str


# Written


def _lines(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue().encode()


def shape_csv(shape: Shape, points: int = POINTS) -> bytes:
    """Return a shape as CSV: a line of names, then one for each of many evenly spaced stations.

    Arc length and position [m], the frame's columns t, n, b, strains tau, xi, k [1/m] and q.
    """
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    within("points", points, 2, 1_000_000)
    s = np.linspace(0.0, shape.arm.length, points)
    frames = np.swapaxes(shape.frame(s), 1, 2).reshape(points, 9)
    rows = np.column_stack([s, shape.position(s), frames, shape.strain(s)])
    return _lines(SHAPE_COLUMNS, rows.tolist())


def save_shape(shape: Shape, path: str | Path, points: int = POINTS) -> Path:
    """Write a shape to a .csv file, whole or not at all; see shape_csv for its columns.

    Raises InputError for another suffix, and where it cannot be written.
    """
    return write_named(path, ".csv", shape_csv(shape, points))


def plan_csv(plan: Any) -> bytes:
    """Return a plan as CSV, what one drives the arm by: a line of names, then a tendon a line.

    Section and tendon by their names, tension [N], the length that the winch leaves between base
    and anchorage [mm], the stroke that it has taken in [mm], and whether the tendon is taut or
    slack. Lengths and strokes are empty where the statics have none, or the tensions do not settle.
    """
    arm, tensions = plan.arm, np.ravel(plan.tensions).tolist()
    shape = of_shape(plan)
    slack = [T <= 0 for T in tensions] if shape["slack"] is None else shape["slack"].ravel()
    lengths, strokes = (_mm(arm, shape[key]) for key in ("lengths_m", "strokes_m"))
    states = ["slack" if item else "taut" for item in slack]
    sections = [section + 1 for section, _ in arm.tendons]
    rows = zip(sections, arm.tendon_names, tensions, lengths, strokes, states, strict=True)
    return _lines(PLAN_COLUMNS, rows)


def _mm(arm: Arm, lengths: Any) -> list[Any]:
    """Return lengths of tendons [m] in mm; empty cells for none."""
    none = [""] * arm.n_tendons
    return none if lengths is None else [number_in(x, "mm") for x in np.ravel(lengths).tolist()]


def motion_csv(motion: Any) -> bytes:
    """Return a motion as CSV: times [s], tensions [N] and lengths [m] of the tendons."""
    names = [name.replace(",", "_") for name in motion.arm.tendon_names]
    columns = ["t_s", *(f"{name}_N" for name in names), *(f"{name}_length_m" for name in names)]
    return _lines(columns, np.column_stack([motion.times, motion.flat, motion.lengths]).tolist())


# Read


def _read(path: Path, wanted: str) -> Iterator[tuple[str, list[str]]]:
    """Yield where a line is, and its cells, of all lines that hold something; FileError."""
    text = bytes_of(path, f"{wanted} is wanted").decode("utf-8-sig", errors="replace")
    for number, row in enumerate(csv.reader(text.splitlines()), 1):
        if any(row) or number == 1:
            yield f"line {number}", [cell.strip() for cell in row]


def _number(column: str, cells: dict[str, str], more: str = "") -> float:
    """Return the number in a column, in SI units; InputError."""
    try:
        value = float(cells.get(column, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(column, cells.get(column, ""), f"a number{more}")
    return float(in_si(value, "mm" if column.endswith("_mm") else ""))


def load_waypoints(path: Path) -> tuple[list[TipPosition], Array | None]:
    """Return the places of tips and the times of a file: x_m, y_m, z_m and, if it has, t_s.

    Raises FileError.
    """
    lines = _read(path, "a CSV file of waypoints")
    header = next(lines, ("", []))[1]
    columns = [*WAYPOINT_COLUMNS, *["t_s"] * ("t_s" in header)]
    rows = []
    for where, row in lines:
        with error_context(str(path), where):
            cells = dict(zip(header, row, strict=False))
            rows.append([_number(column, cells) for column in columns])
    if not rows:
        raise FileError(str(path), "", f"no lines below a heading {', '.join(WAYPOINT_COLUMNS)}")
    times = np.array(rows)[:, 3] if len(columns) > 3 else None
    return [TipPosition(tuple(row[:3])) for row in rows], times


def load_shapes(
    path: Path, arm: Arm, points: Sequence[MarkerColumns] = (), **stds: float | None
) -> tuple[Measured, ...]:
    """Return the shapes of a CSV file, of such standard deviations as Measured has.

    FileError with the row and the column for what is wrong.
    """
    name = str(path)
    lines = _read(path, "a CSV file of shapes")
    header = next(lines, ("", []))[1]
    # By argument of Measured, and by marker.
    columns = {"tensions": [f"{tendon}_N" for tendon in arm.tendon_names], "tip": _place("tip")}
    for key in ("length", "stroke"):
        columns[f"{key}s"] = [f"{key}_{tendon}_mm" for tendon in arm.tendon_names]
    places = [_place(point.name) for point in points]
    known = ["name", "session", *chain(*columns.values()), *chain(*places)]
    for column in header:
        if column not in known or header.count(column) > 1:
            problem = f"must be a column, named once, of {', '.join(known)}"
            raise FileError(name, "line 1", problem, repr(column))
    drives = [columns[key] for key in ("tensions", "lengths", "strokes")]
    for column in chain(*([each for each in drives if {*each} & {*header}] or drives[:1])):
        if column not in header:
            raise FileError(name, "line 1", f"missing column {column}")
    result = []
    for where, row in lines:
        if len(row) != len(header):
            raise FileError(name, where, f"{len(row)} cells; the header has {len(header)}")
        cells = dict(zip(header, row, strict=True))
        with error_context(name, where):
            values: dict[str, Any] = {key: _values(each, cells) for key, each in columns.items()}
            seen = [
                (in_si(point.s_mm, "mm"), in_si(point.offset_mm, "mm"), _values(place, cells))
                for point, place in zip(points, places, strict=True)
            ]
            named = {"name": cells.get("name") or where, "session": cells.get("session", "")}
            result.append(Measured(points=seen, **stds, **named, **values))  # type: ignore[arg-type]
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
    unseen = "; leave all cells of a marker that was not seen empty"
    return [_number(column, cells, unseen) for column in columns]
