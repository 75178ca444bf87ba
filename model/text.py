"""Values as people read them: tables that fit a screen, and the same in notebooks."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Sequence
from typing import Any

# Tendons in a line of a table; lines of a table in a repr.
_ACROSS, MOST_LINES = 6, 12

# How the figure of a kind of result is drawn, as PNG; whoever can draw says so.
_figures: dict[type, Callable[[Any], bytes]] = {}


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


def tendon_lines(
    sections: Sequence[tuple[float, Sequence[str]]], values: Sequence[float]
) -> list[str]:
    """Return a table of a number for each tendon, a line a section, of many tendons several.

    Parameters
    ----------
    sections : sequence of (at, names)
        Arc length of each anchorage [m] and its tendons' names, in tendon order.
    values : (n_tendons,)
    """
    numbers = iter(values)
    heads = [f"  section {i + 1} (at {1e3 * at:g} mm)" for i, (at, _) in enumerate(sections)]
    width = max(map(len, heads))
    lines = []
    for head, (_, names) in zip(heads, sections, strict=True):
        cells = [f"{name:>7} {next(numbers):9.4f}" for name in names]
        for begin in range(0, len(cells), _ACROSS):
            start = head if begin == 0 else ""
            lines.append(f"{start:<{width}}{''.join(cells[begin : begin + _ACROSS])}")
    return lines


def drawn_by(kind: type, draw: Callable[[Any], bytes]) -> None:
    """Let notebooks show values of a kind with a figure, as PNG."""
    _figures[kind] = draw


def in_notebook(value: Any) -> str:
    """Return HTML: the figure of a value, where one can be drawn, and its text."""
    text = f"<pre>{html.escape(str(value))}</pre>"
    draw = _figures.get(type(value))
    if draw is None:
        return text
    png = base64.b64encode(draw(value)).decode()
    return f'<img src="data:image/png;base64,{png}" style="max-width: 100%"/>{text}'
