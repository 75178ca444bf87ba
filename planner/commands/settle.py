"""octoplan settle: the shape under a scene's tensions, or by its tendons' lengths."""

from __future__ import annotations

import argparse
from typing import Any

from model import Shape, settle
from planner.commands.command import (
    OK,
    Answer,
    Command,
    add_compiled_options,
    held_of,
    question,
)
from planner.io.csv_files import shape_csv
from planner.io.records import shape_record
from planner.report import settled_text


def run(args: argparse.Namespace) -> Answer:
    """Settle the arm under the scene's tensions, or by its lengths."""
    asked, accuracy = question(args)
    held = held_of(asked, args.scene)
    shape = settle(asked.arm, scene=asked.scene, accuracy=accuracy, compile=asked.compile, **held)
    return Answer(
        OK,
        lambda: settled_text(shape),
        shape_record(shape),
        "shape",
        lambda: _draw(shape),
        {"shape.csv": shape_csv(shape)} if args.out else {},
    )


def _draw(shape: Shape) -> Any:
    from planner.plots.plan import plot_shape

    return plot_shape(shape)


COMMAND = Command(
    "settle", "find the shape under the scene's tensions or lengths", add_compiled_options, run
)
