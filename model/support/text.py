"""Values as people read them: tables that fit a screen, and the same in notebooks."""

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
# Tendons in a line of a table; lines of a table in a repr.
_ACROSS, MOST_LINES = 6, 12

# How the figure of a kind of value is drawn, and what is told of it; whoever can says so.
# What is called before the first of them is looked for.
_later: list[Callable[[], Any]] = []
# What a value is told by: a paragraph, or a table by its rows, the names of its columns first.
Part = str | Sequence[Sequence[str]]
_Way = tuple[Callable[..., Any] | None, Callable[[Any], Iterable[Part]]]
_shown: dict[type, _Way] = {}


def columns(rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Return lines in which the cells of rows stand below each other, two blanks apart.

    The first `left` columns are flush left, the others flush right, but for the last of a row that
    is longer than the first row: it is text that follows.
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
    """Return how many of something there are: "1 shape", "2 shapes"."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def shortened_lines(lines: list[str], most: int = MOST_LINES) -> list[str]:
    """Return lines, of many the first and how many more there are."""
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
    """Let values of a kind be shown by a figure, `plot(value, ax)`, and by paragraphs and tables.

    As text (`to_text`) and in notebooks.
    """
    _shown[kind] = plot, parts


def parts_of(value: Any) -> Iterator[Part]:
    """Yield the paragraphs and tables of a value."""
    yield from _shown_as(value)[1](value)


def to_text(value: Any) -> str:
    """Return the paragraphs and tables of a value as text."""
    return "\n".join(
        part if isinstance(part, str) else indent("\n".join(columns(part, len(part[0]))), "  ")
        for part in parts_of(value)
    )


def register_display(load: Callable[[], Any]) -> None:
    """Let `load` be called where a figure is wanted first: it says how values are shown."""
    _later[:] = [load]


def plotted(value: Any, ax: Any = None) -> Any:
    """Return the figure of a value, or draw it in axes and return these.

    Raises OctoplanError where nothing is loaded that draws.
    """
    plot, _ = _shown_as(value)
    if plot is None:
        raise OctoplanError("figures are drawn by octoplan.planner: import it first")
    return plot(value, ax)


def _html(part: Part) -> str:
    """Return a paragraph as it stands, long lines broken between words, or a table, in HTML.

    Its numbers are flush right.
    """
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
    """What notebooks show by its figure and by what is told of it; see shown_by."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return the figure, where one can be drawn, then paragraphs and tables."""
        plot, parts = _shown_as(self)
        text = "".join(map(_html, parts(self)))
        if plot is None:
            return text
        file = io.BytesIO()
        plot(self).savefig(file, format="png", bbox_inches="tight")
        png = base64.b64encode(file.getvalue()).decode()
        return f'<img src="data:image/png;base64,{png}" style="max-width: 100%"/>{text}'


class TextRepr(HtmlRepr):
    """What is read by what is told of it: all where it is printed, the first part where named."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(next(parts_of(self)))

    def __str__(self) -> str:
        return to_text(self)


def _shown_as(value: Any) -> _Way:
    kinds = type(value).__mro__
    if _later and not any(kind in _shown for kind in kinds):
        _later.pop()()
    return next((_shown[kind] for kind in kinds if kind in _shown), (None, _in_words))


def ends_text(path: Path, span: float) -> str:
    """Return a function of arc length by its values at base and end [mm]."""
    base, end = 1e3 * path.evaluate(np.array([0.0, span]), span)[0]
    return f"{base:.4g}" if base == end else f"{base:.4g} to {end:.4g}"


def tendon_table(
    title: str, by_section: Sequence[tuple[float, Sequence[str]]], values: Array
) -> str:
    """Return a table of a number for each tendon, a line a section, of many tendons several.

    Parameters
    ----------
    by_section : sequence of (at, names)
        Arc length of each anchorage [m] and its tendons' names, in tendon order.
    values : array of n_tendons numbers
    """
    numbers = iter(np.ravel(values).tolist())
    heads = [f"  section {i + 1} (at {1e3 * at:g} mm)" for i, (at, _) in enumerate(by_section)]
    width, lines = max(map(len, heads)), [title]
    for head, (_, names) in zip(heads, by_section, strict=True):
        cells = [f"{name:>7} {next(numbers):9.4f}" for name in names]
        for begin in range(0, len(cells), _ACROSS):
            start = head if begin == 0 else ""
            lines.append(f"{start:<{width}}{''.join(cells[begin : begin + _ACROSS])}")
    return "\n".join(lines)


def shape_text(
    tables: Sequence[str], tip: Array, frame: Array, error: float, remarks: Sequence[str] = ()
) -> str:
    """Return tables of the tendons, then where the tip is [m], its frame, the estimated error.

    Last come remarks, a sentence each.
    """
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
