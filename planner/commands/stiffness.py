"""octoplan stiffness: how the shape under a scene's tensions answers to a small force."""

from __future__ import annotations

import argparse
import math
from typing import Any

from model.stiffness import Stiffness, stiffness
from planner.commands.command import (
    OK,
    Answer,
    Command,
    add_compiled_options,
    held_of,
    question,
)
from planner.records.stiffness import stiffness_record
from planner.report import stiffness_text


def run(args: argparse.Namespace) -> Answer:
    """Find the compliance that the scene's [stiffness] table asks for."""
    asked, accuracy = question(args)
    held = {**asked.stiffness, "compile": asked.compile, **held_of(asked, args.scene)}
    k = stiffness(asked.arm, scene=asked.scene, accuracy=accuracy, **held)
    return Answer(OK, lambda: stiffness_text(k), stiffness_record(k), "stiffness", lambda: _draw(k))


def _draw(k: Stiffness) -> Any:
    """Draw the ellipsoid of a force, a power of ten, that moves the point by up to L / 5."""
    from planner.plots.stiffness import plot_ellipsoids

    most = 0.2 * k.shape.arm.length / float(k.ellipsoid()[0][0])
    return plot_ellipsoids([k], 10.0 ** math.floor(math.log10(most)))


COMMAND = Command(
    "stiffness",
    "find how the shape under the scene's tensions answers to a small force",
    add_compiled_options,
    run,
)
