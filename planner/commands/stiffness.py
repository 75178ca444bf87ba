"""octoplan stiffness: how the shape under a scene's tensions answers to a small force."""

from __future__ import annotations

import argparse
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
from planner.io.records import stiffness_record
from planner.notebook import force_to_show


def run(args: argparse.Namespace) -> Answer:
    """Find the compliance that the scene's [stiffness] table asks for."""
    asked, accuracy = question(args)
    held = {**asked.stiffness, "compile": asked.compile, **held_of(asked, args.scene)}
    k = stiffness(asked.arm, scene=asked.scene, accuracy=accuracy, **held)
    return Answer(OK, lambda: repr(k), stiffness_record(k), "stiffness", lambda: _draw(k))


def _draw(k: Stiffness) -> Any:
    from planner.plots.stiffness import plot_ellipsoids

    return plot_ellipsoids([k], force_to_show(k))


COMMAND = Command(
    "stiffness",
    "find how the shape under the scene's tensions answers to a small force",
    add_compiled_options,
    run,
)
