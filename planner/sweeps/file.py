"""Sweep files: read, and checked before anything runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from model import InputError
from model.effects import PrintedStatics
from model.errors import FileError
from model.loads import check_loads, is_loaded
from planner.io.key_paths import changed, checked_key, unit_of
from planner.io.mistakes import told_in
from planner.io.scene_file import (
    Question,
    converted,
    decoded,
    filled,
    question_of,
    text_of,
)
from planner.io.slips import warn_of_slip
from planner.sweeps.axes import Axis, values_of
from planner.sweeps.definition import Sweep
from planner.sweeps.tables import MOST_POINTS, AxisTable, SweepFile, SweepTable
from planner.sweeps.variables import RESERVED

_SUCH = """

scene = "scene.toml"
[sweep]
compute = "settle"
[[sweep.axes]]
key = "arm.E_kPa"
values = [100.0, 120.0]"""
# What both NetCDF and the files of a Zarr folder can be named.
_NAME, _LONGEST = re.compile(r"\w([^/\\\x00-\x1f\x7f]*\S)?"), 200


def load_sweep(path: str | Path, time_limit: float | None = None) -> Sweep:
    """Return what a sweep file asks; a time limit of each point [s] goes before the scene's.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed: nothing has run then.
    """
    path = Path(path)
    text = text_of(path)
    return _sweep(decoded(text, str(path)), path, time_limit, {"sweep": text.decode()})


def sweep_of(table: dict[str, Any], time_limit: float | None = None) -> Sweep:
    """Return what a sweep file would ask that held a table, its scene in it; see load_sweep."""
    return _sweep(table, Path("sweep"), time_limit, {})


def _sweep(
    raw: dict[str, Any], path: Path, time_limit: float | None, texts: dict[str, str]
) -> Sweep:
    name = str(path)
    needed = f"a sweep file is such as {_SUCH}"
    file: SweepFile = converted(raw, SweepFile, "sweep", name, needed)
    scene, scene_name, prefix = file.scene, name, "scene."
    if isinstance(scene, str):
        beside = path.parent / scene
        text = text_of(beside)
        scene_name, prefix = str(beside), ""
        scene, texts["scene"] = decoded(text, scene_name), text.decode(errors="replace")
    try:
        scene = filled(scene, scene_name)
        asked = question_of(scene, scene_name)
    except FileError as reason:
        raise FileError(reason.path, f"{prefix}{reason.where}", reason.problem) from None
    scene |= {} if time_limit is None else {"time_limit_s": time_limit}
    with told_in(name, "sweep.compute"):
        _check_compute(asked, file.sweep.compute)
    axes = _axes(file.sweep, scene, scene_name, name)
    closed = file.sweep.compute == "settle" and not is_loaded(asked.scene) and not asked.winches
    together = closed and all(axis.key.startswith("tensions") for axis in axes)
    tendons = tuple(asked.arm.tendon_name(j) for j in range(asked.arm.n_tendons))
    given = (axes, file.sweep.draws or 0, tendons, together, texts)
    sweep = Sweep(file.sweep.compute, scene, scene_name, *given)
    if sweep.size > MOST_POINTS:
        allowed = f"{sweep.size} points; allowed is up to {MOST_POINTS}"
        raise FileError(name, "sweep.axes", allowed)
    return sweep


def _axes(table: SweepTable, scene: dict[str, Any], scene_name: str, name: str) -> tuple[Axis, ...]:
    """Return the axes, grids first; FileError for values that the scene does not allow."""
    axes: list[Axis] = []
    for i, own in enumerate(table.axes):
        where = f"sweep.axes[{i}]"
        with told_in(name, where):
            axis = _axis(own, table, scene)
        if any(axis.key == other.key or axis.name == other.name for other in axes):
            told = f"got {axis.name!r}, which another axis is; allowed is each key once"
            raise FileError(name, where, told)
        for value in axis.extremes:
            try:
                asked = question_of(changed(scene, [axis.key], [value]), scene_name)
            except FileError as reason:
                told = f"{axis.key} = {value!r}: {reason.where}: {reason.problem}"
                raise FileError(name, where, told) from None
            with told_in(name, where):
                _check_compute(asked, table.compute)
        warn_of_slip(axis.key, axis.values.tolist())
        axes.append(axis)
    if table.draws is not None and not any(axis.drawn for axis in axes):
        raise FileError(name, "sweep.draws", "got draws, and no axis with a distribution")
    return tuple(sorted(axes, key=lambda axis: axis.drawn))


def _axis(own: AxisTable, table: SweepTable, scene: dict[str, Any]) -> Axis:
    key = checked_key(scene, own.key)
    name = key if own.name is None else own.name
    if name in RESERVED or not _NAME.fullmatch(name) or len(name.encode()) > _LONGEST:
        allowed = (
            "a name without / and \\ that begins with a letter, a digit or _, of up to "
            f"{_LONGEST} bytes, and none of {', '.join(sorted(RESERVED))}"
        )
        raise InputError("name", name, allowed)
    values = values_of(own, table.draws, table.seed)
    return Axis(key, name, values, unit_of(scene, key), own.distribution is not None)


def _check_compute(asked: Question, compute: str) -> None:
    """Raise InputError, naming it, for what a scene has that a sweep does not take.

    Or lacks: a plan needs targets and limits, the others tensions or lengths.
    """
    if asked.scene.has(PrintedStatics):
        raise InputError("compute", f"{compute} as printed", "a scene without as_printed")
    if compute == "plan":
        if not asked.targets or "tension_max" not in asked.options:
            raise InputError("compute", "plan", "plan for a scene with [target] and [limits]")
    elif asked.tensions is None and not asked.winches:
        told = f"{compute} for a scene with tensions, lengths_mm or strokes_mm"
        raise InputError("compute", compute, told)
    if compute != "settle":
        check_loads(asked.arm, asked.scene, contact=True)
