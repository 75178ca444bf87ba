"""Commands that answer for a scene file: plan, trajectory, settle, stiffness, effects, live."""

from __future__ import annotations

import sys
from dataclasses import replace

from model import OctoplanError
from model.time_limit import OutOfTime
from planner.commands.answer import NOT_REACHED, OK, Answer, figure
from planner.commands.options import Accuracy, FileOptions, SceneFile, SceneOptions
from planner.effect_ablation import switch_effects
from planner.io.calls import check_complete, in_motion, planned, settled, stiff
from planner.io.csv_files import plan_csv, shape_csv
from planner.io.records import (
    EffectsRecord,
    ShapeRecord,
    StiffnessRecord,
    TrajectoryRecord,
    record,
)
from planner.io.saved_records import plan_record
from planner.io.scene_file import load
from planner.live.handles import handle_of
from planner.live.page import Page
from planner.live.session import Session
from planner.notebook import force_to_show
from planner.plan import Plan
from planner.report import settled_text, switch_table
from planner.trajectory.result import Trajectory

_DEFAULT = SceneOptions()


def plan(scene: SceneFile, /, *, options: SceneOptions = _DEFAULT) -> Answer:
    """Find the tensions of least effort for the scene's target."""
    result = planned(options.asked(scene))
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


def trajectory(scene: SceneFile, /, *, options: SceneOptions = _DEFAULT) -> Answer:
    """Find tensions over time through the scene's waypoints."""
    result = in_motion(options.asked(scene))
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: _trajectory_text(result),
        record(TrajectoryRecord, result),
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


def settle(scene: SceneFile, /, *, options: SceneOptions = _DEFAULT) -> Answer:
    """Find the shape under the scene's tensions or lengths."""
    shape = settled(options.asked(scene))
    return Answer(
        OK,
        lambda: settled_text(shape),
        record(ShapeRecord, shape),
        "shape",
        figure("plan", "plot_shape", shape),
        {"shape.csv": lambda: shape_csv(shape)},
    )


def stiffness(scene: SceneFile, /, *, options: SceneOptions = _DEFAULT) -> Answer:
    """Find the compliance that the scene's [stiffness] table asks for."""
    k = stiff(options.asked(scene))
    ellipsoids = figure("results", "plot_ellipsoids", [k], force_to_show(k))
    return Answer(OK, lambda: repr(k), record(StiffnessRecord, k), "stiffness", ellipsoids)


def effects(
    scene: SceneFile, /, *, accuracy: Accuracy | None = None, options: FileOptions = _DEFAULT
) -> Answer:
    """Settle the scene with each effect switched in turn."""
    question = options.loaded(scene, accuracy)
    check_complete(question, "tensions")
    accuracy = question.accuracy
    switches = switch_effects(question.arm, question.tensions, question.scene, accuracy)
    return Answer(
        OK,
        lambda: switch_table(switches, accuracy),
        record(EffectsRecord, switches, accuracy=accuracy),
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
    check_complete(question, "target", "limits")
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
