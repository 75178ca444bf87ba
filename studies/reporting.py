"""How studies are asked and report: options, one look for all figures, what Ctrl-C leaves."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from string import ascii_lowercase
from typing import Any

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


def asked(
    doc: str | None, argv: Sequence[str] | None, options: Mapping[str, Any], prog: str | None = None
) -> argparse.Namespace:
    """Return what a study is asked; the folder of its `--out` is made.

    Each option by its default, or with more of what argparse takes: (default, {..}). A list takes
    any number of values, False is a switch.
    """
    parser = argparse.ArgumentParser(prog, description=(doc or "").partition("\n")[0])
    for name, option in options.items():
        default, more = option if isinstance(option, tuple) else (option, {})
        how: dict[str, Any] = {"default": default, "type": type(default)}
        if isinstance(default, list):
            how |= {"type": type(default[0]), "nargs": "*"}
        elif default is None or default is False:
            how = {} if default is None else {"action": "store_true"}
        parser.add_argument(name, **how | more)
    args = parser.parse_args(argv)
    if "out" in args:
        args.out.mkdir(parents=True, exist_ok=True)
    return args
