"""octoplan settle: the shape under a scene's tensions."""

from __future__ import annotations

import argparse
from typing import Any

from model import Shape, settle
from planner.commands.command import (
    OK,
    Answer,
    Command,
    add_compiled_options,
    question,
    tensions_of,
)
from planner.records.shape import shape_csv, shape_record
from planner.report import shape_text


def run(args: argparse.Namespace) -> Answer:
    """Settle the arm under the scene's tensions."""
    asked, accuracy = question(args)
    tensions = tensions_of(asked, args.scene)
    shape = settle(asked.arm, tensions, asked.scene, accuracy, compile=asked.compile)
    return Answer(
        OK,
        lambda: shape_text(shape),
        shape_record(shape),
        "shape",
        lambda: _draw(shape),
        {".csv": shape_csv(shape)} if args.out else {},
    )


def _draw(shape: Shape) -> Any:
    from planner.plots.plan import plot_shape

    return plot_shape(shape)


COMMAND = Command("settle", "find the shape under the scene's tensions", add_compiled_options, run)
