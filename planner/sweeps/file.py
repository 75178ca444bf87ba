"""Sweep files: read, and checked before anything runs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import InputError
from model.errors import FileError
from model.statics import is_loaded
from planner.files import versions
from planner.scenefile import Question, decoded, question_of, table_of, text_of
from planner.scenes.mistakes import mistake
from planner.sweeps.axes import Axis, values_of
from planner.sweeps.keys import changed, checked_key, unit_of, whole
from planner.sweeps.points import Job, Point
from planner.sweeps.tables import MOST_POINTS, AxisTable, SweepFile, SweepTable
from planner.sweeps.variables import RESERVED, VARIABLES

# A chunk is what an interruption loses; it is the same however many workers there are.
_PARTS, _MANY, _SOME = 64, 1000, 16
R = TypeVar("R")


@dataclass(frozen=True)
class Sweep:
    """What a sweep file asks.

    Attributes
    ----------
    job : Job
        What is the same at all points.
    axes : tuple of Axis
        Grids first, in the file's order, then what is drawn.
    draws : int
        How many draws there are at each point of the grids; 0 where nothing is drawn.
    tendons : tuple of str
        Names of the tendons.
    texts : dict of str
        The sweep file and, where it names one, the scene file.
    """

    job: Job
    axes: tuple[Axis, ...]
    draws: int
    tendons: tuple[str, ...]
    texts: dict[str, str]

    @property
    def dims(self) -> dict[str, int]:
        """The Dataset's dimensions that points lie along, with their sizes."""
        grids = {axis.name: len(axis.values) for axis in self.axes if not axis.drawn}
        return {**grids, "draw": self.draws} if self.draws else grids

    def dim(self, axis: Axis) -> str:
        """Return the dimension that an axis lies along."""
        return "draw" if axis.drawn else axis.name

    @property
    def size(self) -> int:
        """How many points there are."""
        return math.prod(self.dims.values())

    @property
    def chunk(self) -> int:
        """How many points make a chunk, the last one but for."""
        if self.job.compute == "plan":
            return 1
        return min(math.ceil(self.size / _PARTS), _MANY if self.job.together else _SOME)

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return math.ceil(self.size / self.chunk)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk, made only now: a value for each axis."""
        numbers = np.arange(chunk * self.chunk, min((chunk + 1) * self.chunk, self.size))
        found = np.unravel_index(numbers, tuple(self.dims.values()))
        places = dict(zip(self.dims, found, strict=True))
        columns = [axis.values.at(places[self.dim(axis)]) for axis in self.axes]
        return list(zip(*columns, strict=True))

    @cached_property
    def identity(self) -> str:
        """A hash of all that the numbers depend on: scene, values, versions."""
        axes = [(axis.key, axis.values) for axis in self.axes]
        kept = list(VARIABLES[self.job.compute])
        told = [self.job.compute, kept, self.job.scene, axes, self.draws, versions(), self.chunk]
        return hashlib.sha256(repr(told).encode()).hexdigest()


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
    try:
        file = msgspec.convert(raw, SweepFile)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, raw, SweepFile) from None
    texts = {"sweep": text.decode()}
    if isinstance(file.scene, str):
        scene_path = path.parent / file.scene
        scene_text = text_of(scene_path)
        texts["scene"] = scene_text.decode(errors="replace")
        scene = _checked_scene(decoded(scene_text, str(scene_path)), str(scene_path), "")
    else:
        scene = _checked_scene(file.scene, name, "scene.")
    asked = question_of(scene, name)
    _within(name, "sweep.compute", lambda: _check_compute(asked, file.sweep))
    axes = _axes(name, scene, file.sweep)
    arm, keys = asked.arm, tuple(axis.key for axis in axes)
    fast = file.sweep.compute == "settle" and not is_loaded(asked.scene)
    together = fast and all(key.startswith("tensions") for key in keys)
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
    if table.compute == "plan":
        if not asked.targets or "tension_max" not in asked.options:
            raise InputError("compute", "plan", "plan for a scene with [target] and [limits]")
    elif asked.tensions is None:
        raise InputError("compute", table.compute, f"{table.compute} for a scene with tensions")


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
    name = own.name or key
    if name in RESERVED or "/" in name:
        allowed = f"a name without /, and none of {', '.join(sorted(RESERVED))}"
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
