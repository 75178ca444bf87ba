"""Commands that answer for a scene file: plan, trajectory, settle, stiffness, effects, live."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from model import OctoplanError
from model import settle as find_shape
from model.errors import FileError
from model.stiffness import stiffness as find_stiffness
from model.time_limit import OutOfTime
from planner import plan as find_plan
from planner.commands.answer import NOT_REACHED, OK, Answer, figure
from planner.commands.options import (
    Accuracy,
    FileOptions,
    SceneFile,
    SceneOptions,
    check_plannable,
    held,
    plan_arguments,
    tensions_of,
)
from planner.effect_ablation import switch_effects
from planner.io.csv_files import plan_csv, shape_csv
from planner.io.records import effects_record, shape_record, stiffness_record, trajectory_record
from planner.io.saved_records import plan_record
from planner.io.scene_file import load
from planner.live.handles import handle_of
from planner.live.page import Page
from planner.live.session import Session
from planner.notebook import force_to_show
from planner.plan import Plan
from planner.report import settled_text, switch_table
from planner.trajectory.motion import trajectory as find_trajectory
from planner.trajectory.result import Trajectory


def plan(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the tensions of least effort for the scene's target."""
    options = options or SceneOptions()
    question = options.asked(scene)
    check_plannable(question, scene)
    arguments = (question.arm, question.targets, question.scene)
    result = find_plan(*arguments, **plan_arguments(question, options))
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: str(result),
        plan_record(result),
        "plan",
        figure("plan", "plot_plan", result),
        {"plan.csv": lambda: plan_csv(result), "shape.csv": lambda: _shape_csv(result)},
    )


def _shape_csv(result: Plan) -> bytes:
    """Return the shape as CSV, of no lines where the tensions do not settle."""
    try:
        return shape_csv(result.shape)
    except (OctoplanError, OutOfTime):
        return b""


_WAYPOINTS = """[[waypoints]] tables, such as type = "tip-position", position_mm = [250, 0, -150]"""
_MOTION = "a [motion] table, such as [motion] rate_max = 5.0 (N/s), or times_s"
_LIMIT_KEYS = (
    "tension_max",
    "tension_min",
    "total_pull",
    "stroke_max",
    "stroke_min",
    "stroke_zero",
)
_TRAJECTORY_KEYS = (*_LIMIT_KEYS, "obstacles", "clearance", "self_clearance")


def trajectory(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find tensions over time through the scene's waypoints."""
    options = options or SceneOptions()
    question = options.asked(scene)
    needed = {
        "waypoints": (question.waypoints, _WAYPOINTS),
        "motion": (any(item is not None for item in question.motion.values()), _MOTION),
        "limits": ("tension_max" in question.options, "a [limits] table with tension_max (N)"),
    }
    for key, (there, such) in needed.items():
        if not there:
            raise FileError(str(scene), key, f"missing; needed is {such}")
    taken = {key: item for key, item in question.options.items() if key in _TRAJECTORY_KEYS}
    more: dict[str, Any] = {"accuracy": question.accuracy, "compile": question.compile}
    ways = list(question.waypoints)
    result = find_trajectory(question.arm, ways, question.scene, **more, **taken, **question.motion)
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: _trajectory_text(result),
        trajectory_record(result),
        "trajectory",
        figure("motion", "plot_trajectory", result),
        {"trajectory.csv": lambda: result.csv},
    )


def _trajectory_text(result: Trajectory) -> str:
    head = f"{'t [s]':>9}  " + " ".join(
        f"{result.arm.tendon_name(j):>7}" for j in range(result.arm.n_tendons)
    )
    rows = [
        f"{t:9.4g}  " + " ".join(f"{item:7.3g}" for item in T)
        for t, T in zip(result.times, result.flat, strict=True)
    ]
    return "\n".join([result.outcome, "", f"{head}  [N]", *rows, "", str(result.certificate)])


def settle(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the shape under the scene's tensions or lengths."""
    options = options or SceneOptions()
    question = options.asked(scene)
    arguments = {
        "accuracy": question.accuracy,
        "compile": question.compile,
        **held(question, scene),
    }
    shape = find_shape(question.arm, scene=question.scene, **arguments)
    return Answer(
        OK,
        lambda: settled_text(shape),
        shape_record(shape),
        "shape",
        figure("plan", "plot_shape", shape),
        {"shape.csv": lambda: shape_csv(shape)},
    )


def stiffness(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the compliance that the scene's [stiffness] table asks for."""
    options = options or SceneOptions()
    question = options.asked(scene)
    arguments = {**question.stiffness, "compile": question.compile, **held(question, scene)}
    k = find_stiffness(question.arm, scene=question.scene, accuracy=question.accuracy, **arguments)
    ellipsoids = figure("results", "plot_ellipsoids", [k], force_to_show(k))
    return Answer(OK, lambda: repr(k), stiffness_record(k), "stiffness", ellipsoids)


def effects(
    scene: SceneFile, /, *, accuracy: Accuracy | None = None, options: FileOptions | None = None
) -> Answer:
    """Settle the scene with each effect switched in turn."""
    question = (options or FileOptions()).loaded(scene, accuracy)
    accuracy, tensions = question.accuracy, tensions_of(question, scene)
    switches = switch_effects(question.arm, tensions, question.scene, accuracy)
    return Answer(
        OK,
        lambda: switch_table(switches, accuracy),
        effects_record(switches, accuracy),
        "effects",
        figure("results", "plot_effects", switches, accuracy),
    )


def live(
    scene: SceneFile,
    /,
    *,
    host: str = "localhost",
    port: int = 8080,
    accuracy: Accuracy | None = None,
    compile: bool = False,  # noqa: A002  (the name of the option)
) -> Answer:
    """Open a page on which the scene's target is dragged and the arm follows.

    It is served until the last browser that looked at it is gone.

    Parameters
    ----------
    host
        Where the page is served (localhost).
    port
        Its port (8080).
    compile
        Work by machine code, see octoplan plan.
    """
    question = load(scene)
    check_plannable(question, scene)
    if accuracy is not None:
        question = replace(question, accuracy=accuracy)
    machine_code = compile or question.compile
    arguments = question.options | {"accuracy": question.accuracy, "compile": machine_code}
    handle = handle_of(question.arm, question.targets)
    page = Page(Session(question.arm, question.scene, handle, arguments), host, port)
    sys.stderr.write(f"octoplan: http://{host}:{port} (ends with the last browser)\n")
    page.wait()
    page.end()
    return Answer(OK, lambda: "The last browser is gone.")
