"""Text and HTML representations of values: paragraphs, tables and figures."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from textwrap import indent
from typing import Any

import numpy as np

from octoplan.model.paths import Array, Path
from octoplan.model.support.errors import OctoplanError

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+|inf|nan)(e[-+]?\d+)?")
# Number of tendons in a line of a table.
_ACROSS = 6
# Number of lines of a table in a repr.
MOST_LINES = 12

# Part of a representation: a paragraph, or the rows of a table, starting with the column names.
Part = str | Sequence[Sequence[str]]
# Functions that draw the figure of a value, and that return its parts.
_Display = tuple[Callable[..., Any] | None, Callable[[Any], Iterable[Part]]]
# Representations by class.
_displays: dict[type, _Display] = {}
# Function that registers more representations, called before the first one is missing.
_later: list[Callable[[], Any]] = []


def columns(rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Return aligned lines of the cells of rows, with two blanks between columns.

    The first `left` columns are left-aligned, the others right-aligned. Cells beyond the length of
    the first row are text that is appended to the line.
    """
    n = len(rows[0])
    widths = [max(len(row[j]) for row in rows if j < len(row)) for j in range(n)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if j < left else cell.rjust(width)
            for j, (cell, width) in enumerate(zip(row, widths, strict=False))
        ]
        lines.append("  ".join([*cells, *row[n:]]).rstrip())
    return lines


def counted(count: int, what: str) -> str:
    """Return a number of things in words: "1 shape", "2 shapes"."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def shortened_lines(lines: list[str], most: int = MOST_LINES) -> list[str]:
    """Return the first lines, and the number of omitted lines if there are more than `most`."""
    if len(lines) <= most:
        return lines
    return [*lines[: most - 1], f"  ... and {len(lines) - most + 1} more"]


def _in_words(value: Any) -> Iterable[Part]:
    return (str(value),)


def shown_by(
    kind: type,
    plot: Callable[..., Any] | None = None,
    parts: Callable[[Any], Iterable[Part]] = _in_words,
) -> None:
    """Register the representation of a class: the figure `plot(value, ax)` and the parts.

    `to_text` and notebooks use the representation.
    """
    _displays[kind] = plot, parts


def parts_of(value: Any) -> Iterator[Part]:
    """Yield the paragraphs and tables of a value."""
    yield from _display_of(value)[1](value)


def to_text(value: Any) -> str:
    """Return the paragraphs and tables of a value as text."""
    return "\n".join(
        part if isinstance(part, str) else indent("\n".join(columns(part, len(part[0]))), "  ")
        for part in parts_of(value)
    )


def register_display(load: Callable[[], Any]) -> None:
    """Register a function that registers representations, to be called when one is missing."""
    _later[:] = [load]


def plotted(value: Any, ax: Any = None) -> Any:
    """Return the figure of a value, or draw the figure in axes and return the axes.

    Raises OctoplanError if no plotting function is registered.
    """
    plot, _ = _display_of(value)
    if plot is None:
        raise OctoplanError("figures are drawn by octoplan.planner: import it first")
    return plot(value, ax)


def _html(part: Part) -> str:
    """Return a paragraph with its line breaks, or a table with right-aligned numbers, in HTML."""
    if isinstance(part, str):
        style = "white-space:pre-wrap;word-break:normal"
        return f"<pre style='{style}'>{html.escape(part)}</pre>" if part else ""
    lines = []
    for i, row in enumerate(part):
        tag = "td" if i else "th"
        sides = ["right" if _NUMBER.fullmatch(cell.strip()) else "left" for cell in row]
        cells = [
            f"<{tag} style='text-align:{side}'>{html.escape(cell)}</{tag}>"
            for side, cell in zip(sides, row, strict=True)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{''.join(lines)}</table>"


class HtmlRepr:
    """Representation in notebooks: figure, paragraphs and tables; see shown_by."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return the figure if one can be drawn, then paragraphs and tables."""
        plot, parts = _display_of(self)
        text = "".join(map(_html, parts(self)))
        if plot is None:
            return text
        file = io.BytesIO()
        plot(self).savefig(file, format="png", bbox_inches="tight")
        png = base64.b64encode(file.getvalue()).decode()
        return f'<img src="data:image/png;base64,{png}" style="max-width: 100%"/>{text}'


class TextRepr(HtmlRepr):
    """Representation as text: str() returns all parts, repr() the first one."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(next(parts_of(self)))

    def __str__(self) -> str:
        return to_text(self)


def _display_of(value: Any) -> _Display:
    kinds = type(value).__mro__
    if _later and not any(kind in _displays for kind in kinds):
        _later.pop()()
    return next((_displays[kind] for kind in kinds if kind in _displays), (None, _in_words))


def ends_text(path: Path, span: float) -> str:
    """Return a function of arc length as text: its values at both ends [mm]."""
    base, end = 1e3 * path.evaluate(np.array([0.0, span]), span)[0]
    return f"{base:.4g}" if base == end else f"{base:.4g} to {end:.4g}"


def tendon_table(
    title: str, by_section: Sequence[tuple[float, Sequence[str]]], values: Array
) -> str:
    """Return a table of a value for each tendon, one or several lines for each section.

    Parameters
    ----------
    title : str
        First line.
    by_section : sequence of (at, names)
        Arc length of each anchorage [m] and its tendons' names, in tendon order.
    values : (n_tendons,)
    """
    numbers = iter(np.ravel(values).tolist())
    heads = [f"  section {i + 1} (at {1e3 * at:g} mm)" for i, (at, _) in enumerate(by_section)]
    width = max(map(len, heads))
    lines = [title]
    for head, (_, names) in zip(heads, by_section, strict=True):
        cells = [f"{name:>7} {next(numbers):9.4f}" for name in names]
        for begin in range(0, len(cells), _ACROSS):
            start = head if begin == 0 else ""
            lines.append(f"{start:<{width}}{''.join(cells[begin : begin + _ACROSS])}")
    return "\n".join(lines)


def shape_text(
    tables: Sequence[str], tip: Array, frame: Array, error: float, remarks: Sequence[str] = ()
) -> str:
    """Return a text of tendon tables, tip position [m], tip frame, estimated error and remarks."""
    place = "  ".join(f"{1e3 * x:.4f}" for x in tip)
    rows = "\n".join("  " + " ".join(f"{x:9.5f}" for x in row) for row in frame)
    return "\n\n".join(
        [
            *tables,
            f"tip [mm]  {place}",
            f"tip frame (columns t, n, b)\n{rows}",
            f"estimated tip error [L]  {error:.1e}",
            *(f"beware: {remark}" for remark in remarks),
        ]
    )
