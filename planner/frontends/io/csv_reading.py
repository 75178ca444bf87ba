"""Read CSV files: separator, decimal mark, header and cells.

Commas or semicolons separate cells, as in the header. Decimal marks are points or commas, the same
mark in the whole file. Files that can be read in two ways are refused.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from octoplan.model.support.errors import FileError
from octoplan.planner.frontends.io.files import read_bytes

# Columns of text, in which commas are no decimal marks.
TEXT_COLUMNS = ("name", "session")
_QUOTED = re.compile(r'"[^"]*"')
_WITH_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_WITH_POINT = re.compile(r"[+-]?[\d,]*\.\d*([eE][+-]?\d+)?")
# Numbers whose comma may also separate thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


@dataclass(frozen=True)
class CsvFile:
    """The header and the lines of a CSV file.

    Attributes
    ----------
    header : tuple of str
        Names of the columns.
    lines : tuple of (str, tuple of str)
        Line number as text, such as "line 2", and cells, with points as decimal marks. Empty lines
        are omitted.
    """

    header: tuple[str, ...]
    lines: tuple[tuple[str, tuple[str, ...]], ...]


def read_csv(path: Path, wanted: str) -> CsvFile:
    """Return the contents of a CSV file; raise FileError, with the line if it is ambiguous.

    `wanted` names the kind of file in the message about a file that cannot be read.
    """
    name = str(path)
    text = read_bytes(path, f"must be {wanted}").decode("utf-8-sig", errors="replace").splitlines()
    separator = _separator(name, text[0] if text else "")
    numbered = enumerate(csv.reader(text, delimiter=separator), 1)
    rows = [(f"line {number}", [cell.strip() for cell in row]) for number, row in numbered]
    header = rows[0][1] if rows else []
    lines = [(where, row) for where, row in rows[1:] if any(row)]
    if _has_decimal_commas(name, header, lines):
        lines = [(where, _with_points(header, row)) for where, row in lines]
    return CsvFile(tuple(header), tuple((where, tuple(row)) for where, row in lines))


def _separator(name: str, header: str) -> str:
    """Return the separator of a header, "," or ";"."""
    unquoted = _QUOTED.sub("", header)
    if ";" not in unquoted:
        return ","
    if "," in unquoted:
        problem = "must have one separator, commas or semicolons; quote names that contain one"
        raise FileError(name, "line 1", problem, repr(header))
    return ";"


def _numeric_cells(
    header: Sequence[str], lines: Sequence[tuple[str, list[str]]]
) -> Iterator[tuple[str, str, str]]:
    """Yield line, column and content of each cell outside the columns of text."""
    for where, row in lines:
        for column, cell in zip(header, row, strict=False):
            if column not in TEXT_COLUMNS:
                yield where, column, cell


def _has_decimal_commas(
    name: str, header: Sequence[str], lines: Sequence[tuple[str, list[str]]]
) -> bool:
    """Return whether commas are decimal marks; raise FileError if points may be, or thousands."""
    cells = list(_numeric_cells(header, lines))
    commas = [item for item in cells if _WITH_COMMA.fullmatch(item[2])]
    points = [item for item in cells if _WITH_POINT.fullmatch(item[2])]
    mixed = [item for item in points if "," in item[2]] or (commas and points)
    if mixed:
        where, column, cell = (commas or mixed)[0]
        other, _, beside = points[0]
        problem = "must have one decimal mark in the file and no separators of thousands"
        if beside != cell:
            problem += f"; {other} has {beside!r}"
        raise FileError(name, f"{where}: {column}", problem, repr(cell))
    if commas and all(_THOUSANDS.fullmatch(cell) for _, _, cell in commas):
        where, column, cell = commas[0]
        problem = "must be a number in which the comma cannot separate thousands; write a point"
        raise FileError(name, f"{where}: {column}", problem, repr(cell))
    return bool(commas)


def _with_points(header: Sequence[str], row: Sequence[str]) -> list[str]:
    """Return cells with points as decimal marks."""
    is_text = [column in TEXT_COLUMNS for column in header] + [False] * len(row)
    return [
        cell.replace(",", ".") if not text and _WITH_COMMA.fullmatch(cell) else cell
        for cell, text in zip(row, is_text, strict=False)
    ]
