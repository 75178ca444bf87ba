"""Sweep files: read, and checked before anything runs."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from model import InputError
from model.errors import FileError
from model.loads import check_loads, is_loaded
from planner.scenefile import Question, converted, decoded, question_of, table_of, text_of
from planner.sweeps.axes import Axis, values_of
from planner.sweeps.definition import Sweep
from planner.sweeps.keys import changed, checked_key, unit_of, whole
from planner.sweeps.tables import MOST_POINTS, AxisTable, SweepFile, SweepTable
from planner.sweeps.variables import RESERVED
from planner.sweeps.worker import Job

_SUCH = """

scene = "scene.toml"
[sweep]
compute = "settle"
[[sweep.axes]]
key = "arm.E_kPa"
values = [100.0, 120.0]"""
# What both NetCDF and the files of a Zarr folder can be named.
_NAME, _LONGEST = re.compile(r"\w([^/\\\x00-\x1f\x7f]*\S)?"), 200
R = TypeVar("R")


def load_sweep(path: str | Path) -> Sweep:
    """Return what a sweep file asks.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed: nothing has run then.
    """
    path = Path(path)
    name, text = str(path), text_of(path)
    raw = decoded(text, name)
    file = converted(raw, SweepFile, "sweep", name, f"a sweep file is such as {_SUCH}")
    texts = {"sweep": text.decode()}
    if not isinstance(file.scene, str):
        return _asked(file, _checked_scene(file.scene, name, "scene."), name, texts)
    scene_path = path.parent / file.scene
    scene_text = text_of(scene_path)
    texts["scene"] = scene_text.decode(errors="replace")
    scene = _checked_scene(decoded(scene_text, str(scene_path)), str(scene_path), "")
    return _asked(file, scene, name, texts)


def sweep_of(table: dict[str, Any], name: str = "sweep") -> Sweep:
    """Return what a sweep file would ask that held a table, its scene in it; see load_sweep."""
    file = converted(table, SweepFile, "sweep", name, "a sweep is wanted")
    assert isinstance(file.scene, dict)
    return _asked(file, _checked_scene(file.scene, name, "scene."), name, {})


def _asked(file: SweepFile, scene: dict[str, Any], name: str, texts: dict[str, str]) -> Sweep:
    """Return what a file asks with its scene, whose defaults are filled in."""
    asked = question_of(scene, name)
    _within(name, "sweep.compute", lambda: _check_compute(asked, file.sweep))
    axes = _axes(name, scene, file.sweep)
    arm, keys = asked.arm, tuple(axis.key for axis in axes)
    fast = file.sweep.compute == "settle" and not is_loaded(asked.scene)
    together = fast and not asked.winches and all(key.startswith("tensions") for key in keys)
    job = Job(file.sweep.compute, scene, keys, arm.n_tendons, together)
    draws = file.sweep.draws or 0
    tendons = tuple(arm.tendon_name(j) for j in range(arm.n_tendons))
    found = Sweep(job, axes, draws, tendons, texts)
    if found.size > MOST_POINTS:
        told = f"{found.size} points; allowed is up to {MOST_POINTS}"
        raise FileError(name, "sweep.axes", told)
    return found


def _checked_scene(raw: dict[str, Any], name: str, prefix: str) -> dict[str, Any]:
    """Return a scene with all its defaults; an error tells where in the file it is."""
    try:
        question_of(raw, name)
        return whole(table_of(raw, name))
    except FileError as reason:
        raise FileError(reason.path, f"{prefix}{reason.where}", reason.problem) from None


def _check_compute(asked: Question, table: SweepTable) -> None:
    if table.compute != "settle":
        check_loads(asked.arm, asked.scene, contact=True)
    if table.compute == "plan":
        if not asked.targets or "tension_max" not in asked.options:
            raise InputError("compute", "plan", "plan for a scene with [target] and [limits]")
    elif asked.tensions is None and not asked.winches:
        told = f"{table.compute} for a scene with tensions, lengths_mm or strokes_mm"
        raise InputError("compute", table.compute, told)


def _axes(name: str, scene: dict[str, Any], table: SweepTable) -> tuple[Axis, ...]:
    found: list[Axis] = []
    for i, own in enumerate(table.axes):
        where = f"sweep.axes[{i}]"
        axis = _within(name, where, lambda own=own: _axis(scene, own, table))  # type: ignore[misc]
        for other in found:
            if other.key == axis.key or other.name == axis.name:
                told = f"got {axis.name!r}, which another axis is; allowed is each key once"
                raise FileError(name, where, told)
        _check_values(name, where, scene, axis)
        found.append(axis)
    drawn = [axis for axis in found if axis.drawn]
    if table.draws is not None and not drawn:
        raise FileError(name, "sweep.draws", "got draws, and no axis with a distribution")
    return (*(axis for axis in found if not axis.drawn), *drawn)


def _axis(scene: dict[str, Any], own: AxisTable, table: SweepTable) -> Axis:
    key = checked_key(scene, own.key)
    name = key if own.name is None else own.name
    if name in RESERVED or not _NAME.fullmatch(name) or len(name.encode()) > _LONGEST:
        allowed = (
            "a name without / and \\ that begins with a letter, a digit or _, of up to "
            f"{_LONGEST} bytes, and none of {', '.join(sorted(RESERVED))}"
        )
        raise InputError("name", name, allowed)
    values = values_of(own, table.draws, table.seed)
    return Axis(key, name, values, unit_of(scene, key))


def _check_values(name: str, where: str, scene: dict[str, Any], axis: Axis) -> None:
    """Refuse an axis whose least or largest value the scene does not allow."""
    for value in axis.values.extremes:
        try:
            question_of(changed(scene, [axis.key], [value]), name)
        except FileError as reason:
            told = f"{axis.key} = {value!r}: {reason.where}: {reason.problem}"
            raise FileError(name, where, told) from None


def _within(name: str, where: str, build: Callable[[], R]) -> R:
    try:
        return build()
    except FileError:
        raise
    except InputError as reason:
        raise FileError.of(reason, name, where) from None
