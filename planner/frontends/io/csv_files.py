"""CSV files: a header of column names with units, then one line of numbers per row.

Plans for winches, shapes along the arm and trajectories are written; measured shapes and waypoints
are read. A file of measured shapes has one shape per line:

    name,session,T_11_N,T_12_N,M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm

`name` and `session` are optional. The drive of the arm is a tension for each tendon, under the
tendon names of the arm, or `length_T_11_mm` or `stroke_T_11_mm` for each tendon, or both. Positions
of markers, by marker name, and of the tip are in mm. Omit columns, leave cells empty or write nan
for coordinates that were not measured. Tendons without tension are held at their lengths or
strokes; without these they are slack.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model import Arm, InputError, Shape
from octoplan.model.paths import Array
from octoplan.model.support.checks import kind, whole
from octoplan.model.support.errors import FileError
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.frontends.io.codec import in_si, number_in
from octoplan.planner.frontends.io.csv_reading import TEXT_COLUMNS, read_csv
from octoplan.planner.frontends.io.files import write_named
from octoplan.planner.frontends.io.mistakes import error_context
from octoplan.planner.frontends.io.records import POINTS, of_shape
from octoplan.planner.frontends.io.varied import MarkerTable
from octoplan.planner.targets import TipPosition

_FRAME = [f"{column}_{axis}" for column in "tnb" for axis in "xyz"]
SHAPE_COLUMNS = ("s_m", "x_m", "y_m", "z_m", *_FRAME, "tau_1_m", "xi_1_m", "k_1_m", "q")
PLAN_COLUMNS = ("section", "tendon", "tension_N", "length_mm", "stroke_mm", "state")
WAYPOINT_COLUMNS = ("x_m", "y_m", "z_m")


class MarkerColumns(MarkerTable, frozen=True, kw_only=True):
    """A marker on the arm; the name is the prefix of the columns in the file of shapes."""

    name: str


# Writing


def _lines(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue().encode()


def shape_csv(shape: Shape, points: int = POINTS) -> bytes:
    """Return a shape as CSV: a header, then one line for each of evenly spaced stations.

    Columns: arc length and position [m], frame columns t, n, b, strains tau, xi, k [1/m] and q.
    """
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    points = whole("points", points, 2, 1_000_000)
    s = np.linspace(0.0, shape.arm.length, points)
    frames = np.swapaxes(shape.frame(s), 1, 2).reshape(points, 9)
    rows = np.column_stack([s, shape.position(s), frames, shape.strain(s)])
    return _lines(SHAPE_COLUMNS, rows.tolist())


def save_shape(shape: Shape, path: str | Path, points: int = POINTS) -> Path:
    """Write a shape to a .csv file, atomically; see shape_csv for the columns.

    Raises InputError for another suffix or if the file cannot be written.
    """
    return write_named(path, ".csv", shape_csv(shape, points))


def plan_csv(plan: Any) -> bytes:
    """Return a plan as CSV to drive the arm by: a header, then one line per tendon.

    Columns: names of section and tendon, tension [N], tendon length from base to anchorage [mm],
    stroke taken in by the winch [mm], taut or slack. Lengths and strokes are empty if the statics
    define none or no equilibrium exists.
    """
    arm = plan.arm
    tensions = np.ravel(plan.tensions).tolist()
    shape = of_shape(plan)
    slack = [T <= 0 for T in tensions] if shape["slack"] is None else shape["slack"].ravel()
    lengths, strokes = (_mm(arm, shape[key]) for key in ("lengths_m", "strokes_m"))
    states = ["slack" if item else "taut" for item in slack]
    sections = [section + 1 for section, _ in arm.tendons]
    rows = zip(sections, arm.tendon_names, tensions, lengths, strokes, states, strict=True)
    return _lines(PLAN_COLUMNS, rows)


def _mm(arm: Arm, lengths: Any) -> list[Any]:
    """Return tendon lengths [m] in mm; empty cells for None."""
    none = [""] * arm.n_tendons
    return none if lengths is None else [number_in(x, "mm") for x in np.ravel(lengths).tolist()]


def motion_csv(motion: Any) -> bytes:
    """Return a trajectory as CSV: times [s], tensions [N] and lengths [m] of the tendons.

    With base joints, insertion [m] and rotation [rad] follow.
    """
    names = motion.arm.tendon_names
    columns = ["t_s", *(f"{name}_N" for name in names), *(f"{name}_length_m" for name in names)]
    values = [motion.times, motion.flat, motion.lengths]
    if motion.question.placement is not None:
        columns += ["insertion_m", "rotation_rad"]
        values.append(motion.base)
    return _lines(columns, np.column_stack(values).tolist())


# Reading


def _number(column: str, cells: dict[str, str]) -> float:
    """Return the number in a column, in SI units; raise InputError."""
    try:
        value = float(cells.get(column, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(column, cells.get(column, ""), "a number")
    return float(in_si(value, "mm" if column.endswith("_mm") else ""))


def load_waypoints(path: Path) -> tuple[list[TipPosition], Array | None]:
    """Return tip targets and times from columns x_m, y_m, z_m and, optionally, t_s.

    Raises FileError.
    """
    file = read_csv(path, "a CSV file of waypoints")
    header = file.header
    columns = [*WAYPOINT_COLUMNS, *["t_s"] * ("t_s" in header)]
    rows = []
    for where, row in file.lines:
        with error_context(str(path), where):
            cells = dict(zip(header, row, strict=False))
            rows.append([_number(column, cells) for column in columns])
    if not rows:
        problem = f"must have lines of numbers below the header {', '.join(WAYPOINT_COLUMNS)}"
        raise FileError(str(path), "", problem)
    times = np.array(rows)[:, 3] if len(columns) > 3 else None
    return [TipPosition(tuple(row[:3])) for row in rows], times


def load_shapes(
    path: Path, arm: Arm, points: Sequence[MarkerColumns] = (), **stds: float | None
) -> tuple[Measured, ...]:
    """Return the shapes of a CSV file; `stds` are standard deviations as in Measured.

    Raises FileError with row and column.
    """
    name = str(path)
    file = read_csv(path, "a CSV file of shapes")
    header = file.header
    # Columns by argument of Measured.
    columns = {"tensions": [f"{tendon}_N" for tendon in arm.tendon_names]}
    for key in ("length", "stroke"):
        columns[f"{key}s"] = [f"{key}_{tendon}_mm" for tendon in arm.tendon_names]
    places = [_place(name) for name in (*(point.name for point in points), "tip")]
    known = [*TEXT_COLUMNS, *chain(*columns.values()), *chain(*places)]
    for column in header:
        if column not in known or header.count(column) > 1:
            problem = f"must be a column, named once, of {', '.join(known)}"
            raise FileError(name, "line 1", problem, repr(column))
    drives = list(columns.values())
    for column in chain(*([each for each in drives if {*each} & {*header}] or drives[:1])):
        if column not in header:
            raise FileError(name, "line 1", f"missing column {column}")
    result = []
    for where, row in file.lines:
        if len(row) != len(header):
            problem = f"must have {len(header)} cells as the header, not {len(row)}"
            if len(row) > len(header):
                problem += "; separate cells by semicolons if commas are decimal marks"
            raise FileError(name, where, problem)
        cells = dict(zip(header, row, strict=True))
        with error_context(name, where):
            values: dict[str, Any] = {key: _values(each, cells) for key, each in columns.items()}
            *seen, tip = (_values(place, cells) for place in places)
            values["tip"] = tip
            values["points"] = [
                (in_si(point.s_mm, "mm"), in_si(point.offset_mm, "mm"), place)
                for point, place in zip(points, seen, strict=True)
            ]
            named = {"name": cells.get("name") or where, "session": cells.get("session", "")}
            result.append(Measured(**stds, **named, **values))  # type: ignore[arg-type]
    if not result:
        raise FileError(name, "", "must have a header and one line per shape")
    return tuple(result)


def _place(name: str) -> list[str]:
    """Return the columns of the position of a marker or the tip."""
    return [f"{name}_{axis}_mm" for axis in "xyz"]


def _values(columns: list[str], cells: dict[str, str]) -> list[float | None] | None:
    """Return the numbers of cells in SI units, None for cells that are empty or nan.

    Return None if all are.
    """
    is_missing = [cells.get(column, "").lower() in ("", "nan") for column in columns]
    if all(is_missing):
        return None
    rows = zip(columns, is_missing, strict=True)
    return [None if missing else _number(column, cells) for column, missing in rows]
