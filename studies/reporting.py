"""How studies report: one look for all figures, and what was finished at Ctrl-C."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from string import ascii_lowercase

from matplotlib.axes import Axes

GRID, INK = "#e3e5e8", "#30343a"
# By what is drawn: a thing has one colour in all panels and figures.
STATICS = {
    "paper": "#1f6fb4",
    "exact tendons": "#e8912c",
    "neo-Hookean": "#2a8c6e",
    "anticlastic": "#b3123f",
}


def lettered(panels: Iterable[tuple[Axes, str]]) -> None:
    """Give panels their letters and titles, and all the same look."""
    for letter, (ax, title) in zip(ascii_lowercase, panels, strict=False):
        ax.set_title(f"{letter}  {title}", loc="left", fontsize=11, color=INK)
        ax.grid(color=GRID, linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)


@contextmanager
def keep_finished() -> Iterator[None]:
    """Leave the block at Ctrl-C and go on after it, with what was finished, and say so."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted: what follows is of what was finished", file=sys.stderr)
