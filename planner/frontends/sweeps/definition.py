"""The definition of a sweep, from a file or from objects, and the division into chunks.

All values are checked before the first point is computed.
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
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.loads import check_loads, is_coupled
from octoplan.model.scene import Scene
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import Described, FileError
from octoplan.planner.frontends.io.calls import check_complete, check_drive
from octoplan.planner.frontends.io.codec import Table, encode, identity, unit_of_type
from octoplan.planner.frontends.io.files import path_of, read_toml
from octoplan.planner.frontends.io.key_paths import changed, checked_key, steps, type_at
from octoplan.planner.frontends.io.mistakes import checked, error_context, warn_of_slip
from octoplan.planner.frontends.io.scene_file import (
    SceneFile,
    fill_defaults,
    question_of,
    scene_beside,
    scene_table,
)
from octoplan.planner.frontends.io.scene_tables import SceneKey
from octoplan.planner.frontends.sweeps.axes import MOST_POINTS, Axis, AxisTable, Count, values_of
from octoplan.planner.frontends.sweeps.points import RESERVED, VARIABLES, Compute, Job
from octoplan.planner.frontends.sweeps.work import Point
from octoplan.planner.targets.base import Target, as_targets


class SweepTable(Table, frozen=True):
    """A sweep: all combinations of the grids, and random values at each grid point."""

    compute: Compute
    axes: Annotated[tuple[AxisTable, ...], Meta(min_length=1, description="the varied values")]
    draws: Annotated[
        Count | None, Meta(description="number of joint draws of the random values")
    ] = None
    seed: Annotated[int, Meta(ge=0, description="of the random values")] = 0


class SweepFile(Table, frozen=True):
    """A sweep file: a scene, as a file or a table, and the sweep."""

    scene: SceneKey
    sweep: SweepTable


# Largest number of points per chunk, and smallest number of chunks if there are enough points. An
# interruption loses the chunks in progress: a plan takes seconds, other points take milliseconds,
# and points that are settled as a batch take less.
_PLANS = (1, 1)
_POINTS = (16, 64)
_TOGETHER = (1000, 16)
# Each chunk is a file.
_MOST_CHUNKS = 10_000


@dataclass(frozen=True, eq=False)
class Sweep:
    """The definition of a sweep.

    Attributes
    ----------
    job : Job
        The computation at each point.
    axes : tuple of Axis
        Grids in the order of the file, then random axes.
    draws : int
        Number of draws at each grid point; 0 without random axes.
    texts : dict of str
        Text of the sweep file and, if there is one, of the scene file.
    """

    job: Job
    axes: tuple[Axis, ...]
    draws: int
    texts: dict[str, str]

    @property
    def dims(self) -> dict[str, int]:
        """Dimensions of the grid of points in the Dataset, with sizes."""
        grids = {axis.name: axis.values.size for axis in self.axes if not axis.drawn}
        return {**grids, "draw": self.draws} if self.draws else grids

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.dims.values())

    @property
    def chunk(self) -> int:
        """Number of consecutive points per chunk; the last chunk may have fewer."""
        others = _PLANS if self.job.compute == "plan" else _POINTS
        points, chunks = _TOGETHER if self.job.together else others
        return max(min(-(-self.size // chunks), points), -(-self.size // _MOST_CHUNKS))

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.size // self.chunk)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk, each with a value for each axis; last dimension fastest."""
        numbers = np.arange(chunk * self.chunk, min((chunk + 1) * self.chunk, self.size))
        places = np.unravel_index(numbers, tuple(self.dims.values()))
        along = dict(zip(self.dims, places, strict=True))
        columns = (
            axis.values[along["draw" if axis.drawn else axis.name]].tolist() for axis in self.axes
        )
        return list(zip(*columns, strict=True))

    @cached_property
    def identity(self) -> str:
        """Hash of everything that determines the results: scene, values, versions."""
        axes = [(axis.key, axis.name, axis.values) for axis in self.axes]
        job = self.job
        names = list(VARIABLES[job.compute])
        return identity(job.compute, names, job.scene, axes, self.draws, self.chunk)


# Sweep files

# Names that are valid in both NetCDF and Zarr.
_NAME = re.compile(r"\w([^/\\\x00-\x1f\x7f]*\S)?")
# Maximal length of a name in bytes.
_LONGEST = 200


def load_sweep(path: str | Path, time_limit: float | None = None) -> Sweep:
    """Return the definition in a sweep file; `time_limit` per point [s] overrides the scene's.

    Raises
    ------
    FileError
        With the file, the key path, the entry and the allowed values; nothing is computed.
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
        scene = fill_defaults(held, scene_name)
        question = question_of(scene, scene_name)
        if file.sweep.compute == "plan":
            check_complete(question, "target", "limits")
        else:
            check_drive(question)
    texts |= {"scene": text} if text else {}
    scene |= {} if time_limit is None else {"time_limit_s": time_limit}
    with error_context(name, "sweep.compute"):
        _check_compute(question, file.sweep.compute)
    axes = _axes(file.sweep, scene, scene_name, name)
    by_lengths = "lengths" in question.options
    closed = (
        file.sweep.compute == "settle"
        and not is_coupled(question.arm, question.scene)
        and not by_lengths
    )
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
    """Return the axes, grids first; raise FileError for values that are invalid in the scene."""
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
            "a name without / and \\ that starts with a letter, a digit or _, of up to "
            f"{_LONGEST} bytes, and different from {', '.join(sorted(RESERVED))}"
        )
        raise InputError("name", name, allowed)
    values = values_of(each, table.draws, table.seed)
    return Axis(
        key, name, values, unit_of_type(type_at(scene, steps(key))), each.distribution is not None
    )


def _check_compute(question: SceneFile, compute: str) -> None:
    """Raise InputError if sweeps do not support an effect of the scene."""
    if question.scene.has(PrintedStatics):
        raise InputError(
            "compute", Described(f"{compute} in a scene as printed"), "a scene without as_printed"
        )
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
    """Return the definition of a sweep of objects; see octoplan.planner.sweep.

    Raises InputError for other types than Arm and Scene and for targets without a table; otherwise
    as load_sweep.
    """
    targets = None if target is None else as_targets(target)
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
        "seed": encode(seed),
    }
    entries |= {} if draws is None else {"draws": encode(draws)}
    table = {
        "scene": scene_table(arm, scene, target if isinstance(target, Target) else targets, **keys),
        "sweep": entries,
    }
    sweep = _sweep(table, Path("sweep"), time_limit, {})
    decoded = sweep.job.question()
    options = decoded.options
    bodies = keys.get("obstacles") or ()
    if bodies and all(isinstance(item, Obstacle) for item in bodies):
        options = options | {"obstacles": list(bodies)}
    original = replace(
        decoded,
        arm=arm,
        scene=scene or Scene(),
        targets=targets if targets and decoded.targets else (),
        options=options,
    )
    return replace(sweep, job=replace(sweep.job, objects=(original, decoded)))
