"""Values as people read them: tables that fit a screen, and the same in notebooks."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from typing import Any

from model.errors import OctoplanError

# Tendons in a line of a table; lines of a table in a repr.
_ACROSS, MOST_LINES = 6, 12

# How the figure of a kind of value is drawn, and its table written; whoever can says so.
# What is called before the first of them is looked for.
_later: list[Callable[[], Any]] = []
_shown: dict[type, tuple[Callable[..., Any] | None, Callable[[Any], str] | None]] = {}


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


def shown_by(
    kind: type, plot: Callable[..., Any] | None = None, table: Callable[[Any], str] | None = None
) -> None:
    """Let notebooks show values of a kind by a figure, `plot(value, ax)`, and a table as HTML."""
    _shown[kind] = plot, table


def shown_later(load: Callable[[], Any]) -> None:
    """Let `load` be called where a figure is wanted first: it says how values are shown."""
    _later[:] = [load]


def plotted(value: Any, ax: Any = None) -> Any:
    """Return the figure of a value, or draw it in axes and return these.

    Raises OctoplanError where nothing is loaded that draws.
    """
    plot, _ = _shown_as(value)
    if plot is None:
        raise OctoplanError("figures are drawn by octoplan: import octoplan, or planner")
    return plot(value, ax)


def preformatted(text: str) -> str:
    """Return a text as it stands, in HTML; long lines are broken."""
    return f"<pre style='white-space:pre-wrap'>{html.escape(text)}</pre>"


def html_table(rows: Sequence[Sequence[str]], title: str = "") -> str:
    """Return rows as a table in HTML, the first as its head; numbers are flush right."""
    lines = [f"<caption style='text-align:left'>{html.escape(title)}</caption>"] if title else []
    for i, row in enumerate(rows):
        tag = "td" if i else "th"
        sides = ["right" if _is_number(cell) else "left" for cell in row]
        cells = [
            f"<{tag} style='text-align:{side}'>{html.escape(cell)}</{tag}>"
            for side, cell in zip(sides, row, strict=True)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{''.join(lines)}</table>"


def in_notebook(value: Any) -> str:
    """Return HTML: the figure of a value, where one can be drawn, and its table, or its text."""
    plot, table = _shown_as(value)
    text = preformatted(str(value)) if table is None else table(value)
    if plot is None:
        return text
    file = io.BytesIO()
    plot(value).savefig(file, format="png", bbox_inches="tight")
    png = base64.b64encode(file.getvalue()).decode()
    return f'<img src="data:image/png;base64,{png}" style="max-width: 100%"/>{text}'


def _shown_as(value: Any) -> tuple[Callable[..., Any] | None, Callable[[Any], str] | None]:
    kinds = type(value).__mro__
    if _later and not any(kind in _shown for kind in kinds):
        _later.pop()()
    return next((_shown[kind] for kind in kinds if kind in _shown), (None, None))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
