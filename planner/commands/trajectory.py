"""octoplan trajectory: tensions over time through a scene's waypoints."""

from __future__ import annotations

import argparse
from typing import Any

from model.errors import FileError
from planner.commands.command import (
    NOT_REACHED,
    OK,
    Answer,
    Command,
    add_scene_options,
    question,
)
from planner.io.records import trajectory_record
from planner.trajectory.motion import trajectory
from planner.trajectory.result import Trajectory

_WAYPOINTS = """[[waypoints]] tables, such as type = "tip-position", position_mm = [250, 0, -150]"""
_MOTION = "a [motion] table, such as [motion] rate_max = 5.0 (N/s), or times_s"
_LIMITS = (
    "tension_max",
    "tension_min",
    "total_pull",
    "stroke_max",
    "stroke_min",
    "stroke_zero",
)
_TAKEN = (*_LIMITS, "obstacles", "clearance", "self_clearance")


def run(args: argparse.Namespace) -> Answer:
    """Find the motion through the scene's waypoints."""
    asked, accuracy = question(args)
    needed = {
        "waypoints": (asked.waypoints, _WAYPOINTS),
        "motion": (any(own is not None for own in asked.motion.values()), _MOTION),
        "limits": ("tension_max" in asked.options, "a [limits] table with tension_max (N)"),
    }
    for key, (there, told) in needed.items():
        if not there:
            raise FileError(str(args.scene), key, f"missing; needed is {told}")
    options = {key: own for key, own in asked.options.items() if key in _TAKEN}
    ways = list(asked.waypoints)
    given = {"accuracy": accuracy, "compile": asked.compile, **options, **asked.motion}
    found = trajectory(asked.arm, ways, asked.scene, **given)
    return Answer(
        OK if found.certificate.passed else NOT_REACHED,
        lambda: _text(found),
        trajectory_record(found),
        "trajectory",
        lambda: _draw(found),
        {"trajectory.csv": found.csv} if args.out else {},
    )


def _text(found: Trajectory) -> str:
    head = f"{'t [s]':>9}  " + " ".join(
        f"{found.arm.tendon_name(j):>7}" for j in range(found.arm.n_tendons)
    )
    rows = [
        f"{t:9.4g}  " + " ".join(f"{own:7.3g}" for own in T)
        for t, T in zip(found.times, found.flat, strict=True)
    ]
    return "\n".join([found.outcome, "", f"{head}  [N]", *rows, "", str(found.certificate)])


def _draw(found: Trajectory) -> Any:
    from planner.plots.trajectory import plot_trajectory

    return plot_trajectory(found)


COMMAND = Command(
    "trajectory", "find tensions over time through the scene's waypoints", add_scene_options, run
)
