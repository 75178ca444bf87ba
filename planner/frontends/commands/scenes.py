"""Commands for scene files: plan, settle, stiffness and others."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from octoplan.model import OctoplanError
from octoplan.model.settle import ACCURACY
from octoplan.model.support.progress import OutOfTime
from octoplan.model.support.text import to_text
from octoplan.planner.frontends.accuracy_study import accuracy_study
from octoplan.planner.frontends.arm_check import check_arm
from octoplan.planner.frontends.bodies.files import What, export_shape
from octoplan.planner.frontends.c_code.export import TAKEN, export_plan
from octoplan.planner.frontends.c_code.export import export as export_map
from octoplan.planner.frontends.c_code.source import Precision
from octoplan.planner.frontends.cli import (
    Accuracy,
    FileOptions,
    Folder,
    Options,
    Output,
    SceneOptions,
    ScenePath,
)
from octoplan.planner.frontends.effect_ablation import TOLERANCE, switch_effects
from octoplan.planner.frontends.io.calls import (
    check_complete,
    run_plan,
    run_settle,
    run_stiffness,
    run_trajectory,
)
from octoplan.planner.frontends.io.csv_files import motion_csv, plan_csv, shape_csv
from octoplan.planner.frontends.io.mistakes import error_context
from octoplan.planner.frontends.io.records import (
    AccuracyRecord,
    CheckRecord,
    EffectsRecord,
    ExportRecord,
    ShapeRecord,
    StiffnessRecord,
    TrajectoryRecord,
    record,
)
from octoplan.planner.frontends.io.saved_records import plan_record
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.frontends.live.handles import handle_of
from octoplan.planner.frontends.live.page import Page
from octoplan.planner.frontends.live.session import Session
from octoplan.planner.frontends.report import figure, switch_table
from octoplan.planner.plan import plan as make_plan
from octoplan.planner.plan_result import Plan

_DEFAULT = SceneOptions()
# Accuracy over the tolerance of `effects` with which shapes are settled.
_RESOLVED = 0.01


def plan(scene: ScenePath, /, *, options: SceneOptions = _DEFAULT) -> Output:
    """Find the tensions of least effort for the scene's target."""
    result = run_plan(options.question(scene))
    tables = {"plan.csv": lambda: plan_csv(result), "shape.csv": lambda: _shape_csv(result)}
    record = plan_record(result)
    certificate = result.certificate
    draw = None if certificate.problem else result.plot
    return Output(lambda: str(result), record, "plan", draw, tables, certificate.passed)


def _shape_csv(result: Plan) -> bytes:
    """Return the shape as CSV; empty if no equilibrium exists."""
    with suppress(OctoplanError, OutOfTime):
        return shape_csv(result.shape)
    return b""


def trajectory(scene: ScenePath, /, *, options: SceneOptions = _DEFAULT) -> Output:
    """Find tensions over time through the waypoints of the scene."""
    result = run_trajectory(options.question(scene))
    return Output(
        lambda: to_text(result),
        record(TrajectoryRecord, result),
        "trajectory",
        result.plot,
        {"trajectory.csv": lambda: motion_csv(result)},
        result.certificate.passed,
    )


def settle(scene: ScenePath, /, *, options: SceneOptions = _DEFAULT) -> Output:
    """Find the shape for the tensions or lengths of the scene."""
    shape = run_settle(options.question(scene))
    tables = {"shape.csv": lambda: shape_csv(shape)}
    return Output(lambda: to_text(shape), record(ShapeRecord, shape), "shape", shape.plot, tables)


def stiffness(scene: ScenePath, /, *, options: SceneOptions = _DEFAULT) -> Output:
    """Find the compliance of the shape of the scene; see the [stiffness] table."""
    k = run_stiffness(options.question(scene))
    return Output(lambda: repr(k), record(StiffnessRecord, k), "stiffness", k.plot)


def accuracy(
    scene: ScenePath,
    /,
    *,
    compile: bool = False,  # noqa: A002  (the name of the option)
    options: FileOptions = _DEFAULT,
) -> Output:
    """Measure error over time of settling and planning the scene; recommend an accuracy.

    Plans are for the target of the scene. Without a target they are for the tip position under the
    tensions of the scene.

    Parameters
    ----------
    compile
        Compile the equations, see octoplan plan.
    """
    question = options.loaded(scene, compiled=compile)
    check_complete(question, "tensions")
    if question.targets:
        check_complete(question, "limits")
    own = ("accuracy", "time_limit")
    study = accuracy_study(
        question.arm,
        question.scene,
        question.tensions,
        question.targets or None,
        **{key: value for key, value in question.of(make_plan).items() if key not in own},
    )
    is_found = study.recommended is not None
    result = record(AccuracyRecord, study)
    return Output(lambda: to_text(study), result, "accuracy", study.plot, reached=is_found)


def effects(
    scene: ScenePath,
    /,
    *,
    tolerance: Annotated[float, Parameter(validator=Number(gt=0, lte=1))] = TOLERANCE,
    accuracy: Accuracy | None = None,
    options: FileOptions = _DEFAULT,
) -> Output:
    """Settle the scene with each effect switched on or off; advise which effects to keep.

    Parameters
    ----------
    tolerance
        Tip movement over arm length from which an effect matters (0.01).
    """
    question = options.loaded(scene, accuracy)
    check_complete(question, "tensions")
    fine = min(question.accuracy, _RESOLVED * tolerance) if accuracy is None else accuracy
    switches = switch_effects(
        question.arm, question.tensions, question.scene, fine, tolerance=tolerance
    )
    length = question.arm.length
    return Output(
        lambda: switch_table(switches, length, tolerance),
        record(EffectsRecord, switches, accuracy=fine, tolerance=tolerance, length_m=length),
        "effects",
        lambda: figure("results", "plot_effects")(switches, length, tolerance),
    )


def check(
    scene: ScenePath,
    /,
    *,
    samples: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    options: FileOptions = _DEFAULT,
) -> Output:
    """Settle random tensions within the limits of the scene in several ways; compare the tips.

    The ways are coarser accuracies, another integrator, base and loads rotated, and loads that act
    after the tensions.

    Parameters
    ----------
    samples
        Number of tension sets (20).
    seed
        Seed of the random numbers (0).
    """
    question = options.loaded(scene)
    check_complete(question, "limits")
    limits = question.options["limits"]
    with error_context(question.name, "limits"):
        result = check_arm(question.arm, question.scene, limits=limits, samples=samples, seed=seed)
    return Output(
        lambda: to_text(result),
        record(CheckRecord, result),
        "check",
        result.plot,
        reached=result.passed,
    )


def live(
    scene: ScenePath,
    /,
    *,
    host: str = "localhost",
    port: int = 8080,
    accuracy: Accuracy | None = None,
    compile: bool = False,  # noqa: A002  (the name of the option)
) -> Output:
    """Open a web page on which the target is dragged and the arm follows.

    The server ends with the last browser.

    Parameters
    ----------
    host
        Host name of the page (localhost).
    port
        Port of the page (8080).
    compile
        Compile the equations, see octoplan plan.
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
    return Output(lambda: "The last browser was closed.")


# Exports

_WHAT = (
    "As C: map from tensions to shape (map), or also tensions for a moving tip target (plan); the "
    "settled arm as STL and glTF (mesh), for MuJoCo (mjcf), as URDF and ROS messages (urdf)."
)


def export(
    scene: ScenePath,
    /,
    *,
    to: Folder,
    what: Annotated[Literal["map", "plan", What], Parameter(help=_WHAT)] = "map",
    links: int = 30,
    precision: Precision = "double",
    accuracy: Accuracy | None = None,
    options: Options = _DEFAULT,
) -> Output:
    """Write the map from tensions to shape or the inverse map as C code, or the settled arm.

    Parameters
    ----------
    to
        Folder of the files.
    links
        Number of links for mjcf and urdf (30).
    precision
        Number type of the C code (double).
    """
    question = options.loaded(scene, accuracy)
    name = c_name(scene)
    more = ""
    static_bytes = 0
    if what == "map" or what == "plan":
        if what == "map":
            check_complete(question, "tensions")
            result = export_map(
                question.arm,
                question.scene,
                to,
                question.tensions,
                accuracy=question.accuracy,
                precision=precision,
                name=name,
            )
        else:
            # The plan is computed to the default accuracy or better.
            fine = question.but(accuracy=min(question.accuracy, ACCURACY))
            result = export_plan(run_plan(fine), to, question.accuracy, precision, name)
        files = result.files
        shape = result.shape
        static_bytes = result.static_bytes
        more = (
            f"\n  {shape.s.size} nodes, tip error {shape.error:.1e} of the length at the "
            f"tensions of the scene or its plan, work arrays {static_bytes} bytes\n"
            f"  to check: make -C {to} check"
        )
    else:
        driven = question.tensions is not None or "lengths" in question.options
        by_plan = question.targets and not driven
        shape = run_plan(question).shape if by_plan else run_settle(question)
        files = export_shape(shape, to, what, name, links)
    text = f"{', '.join(file.name for file in files)} in {to}{more}"
    names = list(map(str, files))
    written = record(ExportRecord, shape, files=names, static_bytes=static_bytes)
    return Output(lambda: text, written, name)


def c_name(scene: Path) -> str:
    """Return a C name for a scene file: fetch_3d for fetch-3d.toml."""
    name = re.sub(r"[\W_]+", "_", scene.stem, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() and name.lower() not in TAKEN else f"arm_{name}".strip("_")
