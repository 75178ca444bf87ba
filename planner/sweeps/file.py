"""Sweep files: read, and checked before anything runs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from model import InputError
from model.errors import FileError
from model.loads import is_loaded
from planner.io.key_paths import changed, checked_key, unit_of
from planner.io.scene_file import (
    check_compute,
    converted,
    decoded,
    filled,
    question_of,
    text_of,
)
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
R = TypeVar("R")


def load_sweep(path: str | Path, time_limit: float | None = None) -> Sweep:
    """Return what a sweep file asks; a time limit of each point [s] goes before the scene's.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed: nothing has run then.
    """
    path = Path(path)
    name, text = str(path), text_of(path)
    file = converted(
        decoded(text, name), SweepFile, "sweep", name, f"a sweep file is such as {_SUCH}"
    )
    texts = {"sweep": text.decode()}
    if not isinstance(file.scene, str):
        scene = _checked_scene(file.scene, name, "scene.", time_limit)
        return _Reader(name, file.sweep, scene, name).sweep(texts)
    beside = path.parent / file.scene
    scene_text = text_of(beside)
    texts["scene"] = scene_text.decode(errors="replace")
    scene = _checked_scene(decoded(scene_text, str(beside)), str(beside), "", time_limit)
    return _Reader(name, file.sweep, scene, str(beside)).sweep(texts)


def sweep_of(table: dict[str, Any], time_limit: float | None = None) -> Sweep:
    """Return what a sweep file would ask that held a table, its scene in it; see load_sweep."""
    file = converted(table, SweepFile, "sweep", "sweep", "a sweep is wanted")
    assert isinstance(file.scene, dict)
    scene = _checked_scene(file.scene, "sweep", "scene.", time_limit)
    return _Reader("sweep", file.sweep, scene, "sweep").sweep({})


def _checked_scene(
    raw: dict[str, Any], name: str, prefix: str, time_limit: float | None
) -> dict[str, Any]:
    """Return a scene with all its defaults; an error tells where in the file it is."""
    limit = {} if time_limit is None else {"time_limit_s": time_limit}
    try:
        return filled(raw, name) | limit
    except FileError as reason:
        raise FileError(reason.path, f"{prefix}{reason.where}", reason.problem) from None


@dataclass(frozen=True)
class _Reader:
    """Reads the [sweep] table of a file.

    Attributes
    ----------
    name : str
        Of the file, for errors.
    table : SweepTable
    scene : dict
        With its defaults.
    scene_name : str
        Of the file that the scene is from.
    """

    name: str
    table: SweepTable
    scene: dict[str, Any]
    scene_name: str

    def sweep(self, texts: dict[str, str]) -> Sweep:
        """Return what the table asks; FileError."""
        compute = self.table.compute
        asked = question_of(self.scene, self.scene_name)
        _within(self.name, "sweep.compute", lambda: check_compute(asked, compute))
        axes = self._axes()
        closed = compute == "settle" and not is_loaded(asked.scene) and not asked.winches
        together = closed and all(axis.key.startswith("tensions") for axis in axes)
        tendons = tuple(asked.arm.tendon_name(j) for j in range(asked.arm.n_tendons))
        given = (axes, self.table.draws or 0, tendons, together, texts)
        sweep = Sweep(compute, self.scene, self.scene_name, *given)
        if sweep.size > MOST_POINTS:
            allowed = f"{sweep.size} points; allowed is up to {MOST_POINTS}"
            raise FileError(self.name, "sweep.axes", allowed)
        return sweep

    def _axes(self) -> tuple[Axis, ...]:
        axes: list[Axis] = []
        for i, own in enumerate(self.table.axes):
            where = f"sweep.axes[{i}]"
            axis = _within(self.name, where, partial(self._axis, own))
            for other in axes:
                if other.key == axis.key or other.name == axis.name:
                    told = f"got {axis.name!r}, which another axis is; allowed is each key once"
                    raise FileError(self.name, where, told)
            for value in axis.extremes:
                self._check_value(where, axis.key, value)
            axes.append(axis)
        drawn = [axis for axis in axes if axis.drawn]
        if self.table.draws is not None and not drawn:
            told = "got draws, and no axis with a distribution"
            raise FileError(self.name, "sweep.draws", told)
        return (*(axis for axis in axes if not axis.drawn), *drawn)

    def _axis(self, own: AxisTable) -> Axis:
        key = checked_key(self.scene, own.key)
        name = key if own.name is None else own.name
        if name in RESERVED or not _NAME.fullmatch(name) or len(name.encode()) > _LONGEST:
            allowed = (
                "a name without / and \\ that begins with a letter, a digit or _, of up to "
                f"{_LONGEST} bytes, and none of {', '.join(sorted(RESERVED))}"
            )
            raise InputError("name", name, allowed)
        values = values_of(own, self.table.draws, self.table.seed)
        return Axis(key, name, values, unit_of(self.scene, key), own.distribution is not None)

    def _check_value(self, where: str, key: str, value: Any) -> None:
        """Refuse a value of an axis that the scene does not allow."""
        try:
            asked = question_of(changed(self.scene, [key], [value]), self.scene_name)
        except FileError as reason:
            told = f"{key} = {value!r}: {reason.where}: {reason.problem}"
            raise FileError(self.name, where, told) from None
        _within(self.name, where, lambda: check_compute(asked, self.table.compute))


def _within(name: str, where: str, build: Callable[[], R]) -> R:
    try:
        return build()
    except FileError:
        raise
    except InputError as reason:
        raise FileError.of(reason, name, where) from None
