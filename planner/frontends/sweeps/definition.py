"""What a sweep computes: its file, or objects in place of one, and its points cut into chunks.

All of it is checked before anything runs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from octoplan.model import InputError
from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles import Obstacle
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.loads import check_loads, is_loaded
from octoplan.model.scene import Scene
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import FileError
from octoplan.planner.frontends.io.calls import check_complete, check_held
from octoplan.planner.frontends.io.codec import Table, encode, identity, unit_of_type
from octoplan.planner.frontends.io.files import path_of, read_toml
from octoplan.planner.frontends.io.key_paths import changed, checked_key, steps, type_at
from octoplan.planner.frontends.io.mistakes import checked, error_context, warn_of_slip
from octoplan.planner.frontends.io.scene_file import (
    SceneFile,
    filled,
    question_of,
    scene_beside,
    scene_table,
)
from octoplan.planner.frontends.io.scene_tables import SceneKey
from octoplan.planner.frontends.sweeps.axes import MOST_POINTS, Axis, AxisTable, Count, values_of
from octoplan.planner.frontends.sweeps.points import RESERVED, VARIABLES, Compute, Job, Point
from octoplan.planner.targets.base import Target


class SweepTable(Table, frozen=True):
    """What to find, and where: all grids by all others, and drawn values jointly with them."""

    compute: Compute
    axes: Annotated[tuple[AxisTable, ...], Meta(min_length=1, description="what varies")]
    draws: Annotated[
        Count | None, Meta(description="how many times the drawn values are drawn, together")
    ] = None
    seed: Annotated[int, Meta(ge=0, description="of the drawn values")] = 0


class SweepFile(Table, frozen=True):
    """A sweep file: a scene, by its file or as a table, and the sweep."""

    scene: SceneKey
    sweep: SweepTable


# A chunk is what an interruption loses: a plan, or up to so many other points, or so many of those
# that are settled together, all in milliseconds; fewer where so many chunks would not be had, which
# workers share.
_PLANS, _POINTS, _TOGETHER = (1, 1), (16, 64), (1000, 16)
# Many chunks are as many files.
_MOST_CHUNKS = 10_000


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep computes.

    Attributes
    ----------
    job : Job
        What is computed at each point.
    axes : tuple of Axis
        Grids first, in the file's order, then what is drawn.
    draws : int
        How many draws there are at each point of the grids; 0 where nothing is drawn.
    texts : dict of str
        The sweep file and, where it names one, the scene file.
    """

    job: Job
    axes: tuple[Axis, ...]
    draws: int
    texts: dict[str, str]

    @property
    def dims(self) -> dict[str, int]:
        """The Dataset's dimensions that points lie along, with their sizes."""
        grids = {axis.name: axis.values.size for axis in self.axes if not axis.drawn}
        return {**grids, "draw": self.draws} if self.draws else grids

    @property
    def size(self) -> int:
        """How many points there are."""
        return math.prod(self.dims.values())

    @property
    def chunk(self) -> int:
        """How many neighbouring points make a chunk; the last one may have fewer."""
        others = _PLANS if self.job.compute == "plan" else _POINTS
        points, chunks = _TOGETHER if self.job.together else others
        return max(min(-(-self.size // chunks), points), -(-self.size // _MOST_CHUNKS))

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return -(-self.size // self.chunk)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk, the last dimension fastest: a value for each axis."""
        numbers = np.arange(chunk * self.chunk, min((chunk + 1) * self.chunk, self.size))
        places = np.unravel_index(numbers, tuple(self.dims.values()))
        along = dict(zip(self.dims, places, strict=True))
        columns = (
            axis.values[along["draw" if axis.drawn else axis.name]].tolist() for axis in self.axes
        )
        return list(zip(*columns, strict=True))

    @cached_property
    def identity(self) -> str:
        """A hash of all that the numbers depend on: scene, values, versions."""
        axes = [(axis.key, axis.name, axis.values) for axis in self.axes]
        kept, job = list(VARIABLES[self.job.compute]), self.job
        return identity(job.compute, kept, job.scene, axes, self.draws, self.chunk)


# Sweep files

# What both NetCDF and the files of a Zarr folder can be named.
_NAME, _LONGEST = re.compile(r"\w([^/\\\x00-\x1f\x7f]*\S)?"), 200


def load_sweep(path: str | Path, time_limit: float | None = None) -> Sweep:
    """Return what a sweep file asks; a time limit of each point [s] goes before the scene's.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed: nothing has run then.
    """
    path = path_of(path)
    raw, text = read_toml(path)
    return _sweep(raw, path, time_limit, {"sweep": text})


def _sweep(
    raw: dict[str, Any], path: Path, time_limit: float | None, texts: dict[str, str]
) -> Sweep:
    name = str(path)
    file: SweepFile = checked(raw, SweepFile, name, "sweep", "sweep")
    with scene_beside(file.scene, path) as (held, scene_name, text):
        scene = filled(held, scene_name)
        question = question_of(scene, scene_name)
        if file.sweep.compute == "plan":
            check_complete(question, "target", "limits")
        else:
            check_held(question)
    texts |= {"scene": text} if text else {}
    scene |= {} if time_limit is None else {"time_limit_s": time_limit}
    with error_context(name, "sweep.compute"):
        _check_compute(question, file.sweep.compute)
    axes = _axes(file.sweep, scene, scene_name, name)
    by_lengths = "lengths" in question.options
    closed = file.sweep.compute == "settle" and not is_loaded(question.scene) and not by_lengths
    together = closed and all(axis.key.startswith("tensions") for axis in axes)
    tendons = tuple(question.arm.tendon_names)
    keys = tuple(axis.key for axis in axes)
    job = Job(file.sweep.compute, scene, scene_name, keys, tendons, together)
    sweep = Sweep(job, axes, file.sweep.draws or 0, texts)
    if sweep.size > MOST_POINTS:
        problem = f"must define at most {MOST_POINTS} points, not {sweep.size}"
        raise FileError(name, "sweep.axes", problem)
    return sweep


def _axes(table: SweepTable, scene: dict[str, Any], scene_name: str, name: str) -> tuple[Axis, ...]:
    """Return the axes, grids first; FileError for values that the scene does not allow."""
    axes: list[Axis] = []
    for i, item in enumerate(table.axes):
        where = f"sweep.axes[{i}]"
        with error_context(name, where):
            axis = _axis(item, table, scene)
        if any(axis.key == other.key or axis.name == other.name for other in axes):
            raise FileError(name, where, "must differ from the other axes", repr(axis.name))
        for value in axis.extremes:
            try:
                question = question_of(changed(scene, [axis.key], [value]), scene_name)
            except FileError as reason:
                problem = f"{axis.key} = {value!r}: {reason.message}"
                raise FileError(name, where, problem) from None
            with error_context(name, where):
                _check_compute(question, table.compute)
        warn_of_slip(axis.key, axis.values.tolist())
        axes.append(axis)
    if table.draws is not None and not any(axis.drawn for axis in axes):
        raise FileError(name, "sweep.draws", "must be omitted: no axis has a distribution")
    return tuple(sorted(axes, key=lambda axis: axis.drawn))


def _axis(each: AxisTable, table: SweepTable, scene: dict[str, Any]) -> Axis:
    key = checked_key(scene, each.key)
    name = key if each.name is None else each.name
    if name in RESERVED or not _NAME.fullmatch(name) or len(name.encode()) > _LONGEST:
        allowed = (
            "a name without / and \\ that begins with a letter, a digit or _, of up to "
            f"{_LONGEST} bytes, and none of {', '.join(sorted(RESERVED))}"
        )
        raise InputError("name", name, allowed)
    values = values_of(each, table.draws, table.seed)
    return Axis(
        key, name, values, unit_of_type(type_at(scene, steps(key))), each.distribution is not None
    )


def _check_compute(question: SceneFile, compute: str) -> None:
    """Raise InputError, naming it, for what a scene has that a sweep does not take."""
    if question.scene.has(PrintedStatics):
        raise InputError("compute", f"{compute} as printed", "a scene without as_printed")
    if compute != "settle":
        check_loads(question.arm, question.scene, contact=True)


# Sweeps of objects


def sweep_of(
    arm: Arm,
    axes: Mapping[str, Any] | None,
    scene: Scene | None = None,
    target: Target | Iterable[Target] | None = None,
    *,
    compute: str | None = None,
    draws: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    **keys: Any,
) -> Sweep:
    """Return what is asked of objects in place of a sweep file; see octoplan.planner.sweep.

    Raises InputError for what is no Arm or Scene, and a target that has no keys in scene files;
    else as load_sweep.
    """
    kind("arm", arm, Arm, "an Arm, or the path of a sweep file")
    kind("scene", scene or Scene(), Scene, "a Scene, such as Scene()")
    if not isinstance(axes, Mapping) or not axes:
        text = 'values by key, such as {"arm.E_kPa": [100.0, 120.0]}'
        raise InputError("axes", axes, text)
    entries: dict[str, Any] = {
        "compute": compute or ("settle" if target is None else "plan"),
        "axes": [
            {
                "key": key,
                **(encode(item) if isinstance(item, Mapping) else {"values": encode(item)}),
            }
            for key, item in axes.items()
        ],
        "seed": seed,
    }
    entries |= {} if draws is None else {"draws": draws}
    table = {"scene": scene_table(arm, scene, target, **keys), "sweep": entries}
    sweep = _sweep(table, Path("sweep"), time_limit, {})
    again = sweep.job.question()
    several: tuple[Any, ...] = tuple(target) if isinstance(target, tuple | list) else (target,)
    options, bodies = again.options, keys.get("obstacles") or ()
    if bodies and all(isinstance(item, Obstacle) for item in bodies):
        options = options | {"obstacles": list(bodies)}
    parts: dict[str, Any] = {"scene": scene or Scene(), "targets": several if again.targets else ()}
    original = replace(again, arm=arm, options=options, **parts)
    return replace(sweep, job=replace(sweep.job, objects=(original, again)))
