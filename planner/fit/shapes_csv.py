"""Measured shapes as CSV: a line of names, then a shape a line.

    name,session,T_11_N,T_12_N,M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm

`name` and `session` may be left out; a tension for each tendon, by the arm's names of them; places
of markers, by their names, and of the tip in mm; `length_T_11_mm` and `stroke_T_11_mm` of all
tendons or none. Cells of a marker that was not seen are empty.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from model import Arm, InputError
from model.errors import FileError
from planner.fit.measured import Measured
from planner.io.codec import UNITS
from planner.io.scene_tables import PointTable

_AXES, MM = "xyz", UNITS["mm"]


def load_shapes(
    path: str | Path, arm: Arm, points: Sequence[PointTable] = (), std: float = 1e-3
) -> tuple[Measured, ...]:
    """Return the shapes of a CSV file; FileError with the row and the column for what is wrong."""
    name = str(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as reason:
        told = getattr(reason, "strerror", None) or str(reason)
        raise FileError(name, "", f"{told.lower()}; a CSV file of shapes is wanted") from None
    reader = csv.reader(text.splitlines())
    header = [cell.strip() for cell in next(reader, [])]
    rows = _Rows(name, arm, points, std, header)
    found = [rows.shape(line, row) for line, row in enumerate(reader, 2) if any(row)]
    if not found:
        raise FileError(name, "", "no shapes; a line of names, then a shape a line")
    return tuple(found)


class _Rows:
    """Reads the rows of a file with a header."""

    def __init__(
        self, name: str, arm: Arm, points: Sequence[PointTable], std: float, header: list[str]
    ) -> None:
        self.name, self.points, self.std, self.header = name, points, std, header
        self.tendons = [arm.tendon_name(j) for j in range(arm.n_tendons)]
        places = [f"{p.name}_{x}_mm" for p in points for x in _AXES]
        tensions = [f"{tendon}_N" for tendon in self.tendons]
        runs = [f"{k}_{tendon}_mm" for k in ("length", "stroke") for tendon in self.tendons]
        known = ["name", "session", *tensions, *places, *(f"tip_{x}_mm" for x in _AXES), *runs]
        for column in header:
            if column not in known or header.count(column) > 1:
                allowed = f"columns, each once, of {', '.join(known)}"
                raise FileError(name, "line 1", f"got {column!r}, allowed are {allowed}")
        for column in tensions:
            if column not in header:
                raise FileError(name, "line 1", f"missing column {column}")

    def shape(self, line: int, row: list[str]) -> Measured:
        """Return the shape of a row."""
        if len(row) != len(self.header):
            told = f"{len(row)} cells; the header has {len(self.header)}"
            raise FileError(self.name, f"line {line}", told)
        cells = dict(zip(self.header, (cell.strip() for cell in row), strict=True))
        where = cells.get("name") or f"line {line}"

        def values(columns: list[str], scale: float) -> list[float] | None:
            given = [cells.get(column, "") for column in columns]
            if not any(given):
                return None
            return [
                scale * self._number(line, column, cell)
                for column, cell in zip(columns, given, strict=True)
            ]

        def place(what: str) -> list[float] | None:
            return values([f"{what}_{x}_mm" for x in _AXES], MM)

        points = [(MM * p.s_mm, [MM * x for x in p.offset_mm], place(p.name)) for p in self.points]
        runs = [values([f"{k}_{t}_mm" for t in self.tendons], MM) for k in ("length", "stroke")]
        tensions = values([f"{tendon}_N" for tendon in self.tendons], 1.0)
        if tensions is None:
            raise FileError(self.name, f"line {line}", "no tensions")
        try:
            return Measured(
                tensions,
                points,
                tip=place("tip"),
                lengths=runs[0],
                strokes=runs[1],
                session=cells.get("session", ""),
                name=where,
                std=self.std,
            )
        except InputError as reason:
            raise FileError.of(reason, self.name, f"line {line}") from None

    def _number(self, line: int, column: str, cell: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            allowed = "a number; leave all cells of a marker that was not seen empty"
            raise FileError(
                self.name, f"line {line}, {column}", f"got {cell!r}, allowed is {allowed}"
            )
        return value
