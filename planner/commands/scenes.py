"""Commands that answer for a scene file: plan, settle, stiffness and the others."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from model import OctoplanError, Shape
from model.time_limit import OutOfTime
from planner.bodies.files import What, export_shape
from planner.c_code.export import TAKEN, Exported, export_plan
from planner.c_code.export import export as export_map
from planner.c_code.source import Precision
from planner.cli import (
    NOT_REACHED,
    OK,
    Accuracy,
    Answer,
    FileOptions,
    Folder,
    Options,
    SceneFile,
    SceneOptions,
    figure,
)
from planner.effect_ablation import switch_effects
from planner.io.calls import check_complete, in_motion, planned, settled, stiff
from planner.io.csv_files import motion_csv, plan_csv, shape_csv
from planner.io.records import (
    EffectsRecord,
    ExportRecord,
    ShapeRecord,
    StiffnessRecord,
    TrajectoryRecord,
    record,
)
from planner.io.saved_records import plan_record
from planner.io.scene_file import Question, load
from planner.live.handles import handle_of
from planner.live.page import Page
from planner.live.session import Session
from planner.notebook import force_to_show
from planner.plan import Plan
from planner.plan import plan as make_plan
from planner.report import settled_text, switch_table
from planner.trajectory.result import Trajectory

_DEFAULT = SceneOptions()


def plan(scene: SceneFile, /, *, options: SceneOptions = _DEFAULT) -> Answer:
    """Find the tensions of least effort for the scene's target."""
    result = planned(options.question(scene))
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
    result = in_motion(options.question(scene))
    return Answer(
        OK if result.certificate.passed else NOT_REACHED,
        lambda: _trajectory_text(result),
        record(TrajectoryRecord, result),
        "trajectory",
        figure("motion", "plot_trajectory", result),
        {"trajectory.csv": lambda: motion_csv(result)},
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
    shape = settled(options.question(scene))
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
    k = stiff(options.question(scene))
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
    more = {} if accuracy is None else {"accuracy": accuracy}
    question = question.but(compile=compile or question.options["compile"], time_limit=None, **more)
    handle = handle_of(question.arm, question.targets)
    page = Page(Session(question.arm, question.scene, handle, question.of(make_plan)), host, port)
    sys.stderr.write(f"octoplan: http://{host}:{port} (ends with the last browser)\n")
    page.wait()
    page.end()
    return Answer(OK, lambda: "The last browser is gone.")


# Exports

# Of the plan that an inverse begins from, where its code is to be less accurate.
_PLANNED = 1e-6
_WHAT = (
    "As C: tensions to shape (map), a moving tip target to tensions besides (plan); the settled "
    "arm as STL and glTF (mesh), for MuJoCo (mjcf), as URDF and ROS messages (urdf)."
)


def export(
    scene: SceneFile,
    /,
    *,
    to: Folder,
    what: Annotated[Literal["map", "plan"] | What, Parameter(help=_WHAT)] = "map",
    links: int = 30,
    precision: Precision = "double",
    accuracy: Accuracy | None = None,
    options: Options = _DEFAULT,
) -> Answer:
    """Write the scene's map from tensions to shape or its inverse as C, or its settled arm.

    Parameters
    ----------
    to
        Folder to write to.
    links
        Of the chain of mjcf and urdf (30).
    precision
        Of the C code (double).
    """
    question, name = options.loaded(scene, accuracy), c_name(scene)
    if what == "map":
        check_complete(question, "tensions")
        arguments = (question.arm, question.scene, to, question.tensions, question.accuracy)
        result = export_map(*arguments, precision, name)
    elif what == "plan":
        fine = question.but(accuracy=min(question.accuracy, _PLANNED))
        result = export_plan(planned(fine), to, question.accuracy, precision, name)
    else:
        return _bodies(question, name, to, what, links)
    return Answer(
        OK,
        lambda: _text(result, to),
        _record(result.files, result.shape, result.static_bytes),
        name,
    )


def _bodies(question: Question, name: str, to: Path, what: What, links: int) -> Answer:
    """Write the arm as it settles under the scene's tensions, by its lengths, or by its plan."""
    by_plan = question.targets and question.tensions is None and "lengths" not in question.options
    shape = planned(question).shape if by_plan else settled(question)
    files = export_shape(shape, to, what, name, links)
    text = f"{', '.join(file.name for file in files)} in {to}"
    return Answer(OK, lambda: text, _record(files, shape), name)


def _record(files: Sequence[Path], shape: Shape, static_bytes: int = 0) -> ExportRecord:
    names = list(map(str, files))
    return record(ExportRecord, shape, files=names, static_bytes=static_bytes)


def _text(result: Exported, to: Path) -> str:
    return (
        f"{', '.join(file.name for file in result.files)} in {to}\n"
        f"  {result.shape.s.size} nodes, tip error {result.shape.error:.1e} of the length at the "
        f"tensions of the scene or its plan, work arrays {result.static_bytes} bytes\n"
        f"  check them: make -C {to} check"
    )


def c_name(scene: Path) -> str:
    """Return a name for C made from that of a scene file: fetch-3d.toml gives fetch_3d."""
    name = re.sub(r"[\W_]+", "_", scene.stem, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() and name.lower() not in TAKEN else f"arm_{name}".strip("_")
