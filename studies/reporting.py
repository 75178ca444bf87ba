"""Command-line options, figure style and handling of Ctrl-C for the studies."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from string import ascii_lowercase
from typing import Any

from matplotlib.axes import Axes

# Colour of grid lines.
GRID = "#e3e5e8"
# Colour of titles and neutral lines.
INK = "#30343a"
# Colour of each statics, the same in all panels and figures.
STATICS = {
    "paper": "#1f6fb4",
    "exact tendons": "#e8912c",
    "neo-Hookean": "#2a8c6e",
    "anticlastic": "#b3123f",
}


def lettered(panels: Iterable[tuple[Axes, str]]) -> None:
    """Set letters, titles and the common style of panels."""
    for letter, (ax, title) in zip(ascii_lowercase, panels, strict=False):
        ax.set_title(f"{letter}  {title}", loc="left", fontsize=11, color=INK)
        ax.grid(color=GRID, linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)


@contextmanager
def keep_finished() -> Iterator[None]:
    """Leave the block at Ctrl-C, print a notice, and continue with the finished results."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted: the tables contain only the finished cases", file=sys.stderr)


def asked(
    doc: str | None, argv: Sequence[str] | None, options: Mapping[str, Any], prog: str | None = None
) -> argparse.Namespace:
    """Parse the options of a study and create the folder of `--out`.

    `options` maps each option to its default, or to (default, keyword arguments of argparse). An
    option with a list as default takes any number of values; False makes the option a switch.
    """
    parser = argparse.ArgumentParser(prog, description=(doc or "").partition("\n")[0])
    for name, option in options.items():
        default, more = option if isinstance(option, tuple) else (option, {})
        settings: dict[str, Any] = {"default": default, "type": type(default)}
        if isinstance(default, list):
            settings |= {"type": type(default[0]), "nargs": "*"}
        elif default is None or default is False:
            settings = {} if default is None else {"action": "store_true"}
        parser.add_argument(name, **settings | more)
    args = parser.parse_args(argv)
    if "out" in args:
        args.out.mkdir(parents=True, exist_ok=True)
    return args
