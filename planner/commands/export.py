"""octoplan export: the scene's forward map or its inverse as C; its arm for other programs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from model import Shape
from planner.bodies.files import What, export_shape
from planner.c_code.export import TAKEN, Exported, export_plan
from planner.c_code.export import export as export_map
from planner.c_code.source import Precision
from planner.commands.answer import OK, Answer
from planner.commands.options import (
    Accuracy,
    Folder,
    Options,
    SceneFile,
)
from planner.io.calls import check_complete, planned, settled
from planner.io.records import ExportRecord, record
from planner.io.scene_file import Question

_DEFAULT = Options()
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
        fine = replace(question, accuracy=min(question.accuracy, _PLANNED))
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
    by_plan = question.tensions is None and not question.winches and question.targets
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
