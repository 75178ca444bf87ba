"""octoplan trajectory: tensions over time through a scene's waypoints."""

from __future__ import annotations

from typing import Any

from model.errors import FileError
from planner.commands.answer import NOT_REACHED, OK, Answer
from planner.commands.options import SceneFile, SceneOptions
from planner.io.records import trajectory_record
from planner.trajectory.motion import trajectory as find
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


def trajectory(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find tensions over time through the scene's waypoints."""
    options = options or SceneOptions()
    question = options.asked(scene)
    needed = {
        "waypoints": (question.waypoints, _WAYPOINTS),
        "motion": (any(own is not None for own in question.motion.values()), _MOTION),
        "limits": ("tension_max" in question.options, "a [limits] table with tension_max (N)"),
    }
    for key, (there, such) in needed.items():
        if not there:
            raise FileError(str(scene), key, f"missing; needed is {such}")
    taken = {key: own for key, own in question.options.items() if key in _TAKEN}
    more: dict[str, Any] = {"accuracy": question.accuracy, "compile": question.compile}
    ways = list(question.waypoints)
    result = find(question.arm, ways, question.scene, **more, **taken, **question.motion)
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: _text(result),
        trajectory_record(result),
        "trajectory",
        lambda: _draw(result),
        {"trajectory.csv": lambda: result.csv},
    )


def _text(result: Trajectory) -> str:
    head = f"{'t [s]':>9}  " + " ".join(
        f"{result.arm.tendon_name(j):>7}" for j in range(result.arm.n_tendons)
    )
    rows = [
        f"{t:9.4g}  " + " ".join(f"{own:7.3g}" for own in T)
        for t, T in zip(result.times, result.flat, strict=True)
    ]
    return "\n".join([result.outcome, "", f"{head}  [N]", *rows, "", str(result.certificate)])


def _draw(result: Trajectory) -> Any:
    from planner.plots.motion import plot_trajectory

    return plot_trajectory(result)
