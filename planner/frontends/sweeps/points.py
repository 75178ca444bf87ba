"""What is computed at the points of a sweep, each on its own, and the arrays that it is kept in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from octoplan.model import InputError, OctoplanError, settle_many
from octoplan.model.scene import Scene
from octoplan.model.support.progress import ProgressLine, check_time, limited
from octoplan.planner.frontends.io.calls import planned, settled, stiff
from octoplan.planner.frontends.io.codec import arguments
from octoplan.planner.frontends.io.key_paths import changed
from octoplan.planner.frontends.io.scene_file import SceneFile, question_of

Compute = Literal["settle", "plan", "stiffness"]
Point = tuple[Any, ...]
Rows = dict[str, NDArray[Any]]
"""What was computed at some points: each variable by its name, a row for each point."""

LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "displacement": ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z"],
    "wrench": ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"],
}


@dataclass(frozen=True)
class Variable:
    """A quantity of a point.

    Attributes
    ----------
    dims : tuple of str
        Its own dimensions, beside those that the points lie along.
    units, about : str
    blank : float, bool or str
        What it is where it was not computed.
    """

    dims: tuple[str, ...]
    units: str
    about: str
    blank: Any = np.nan

    def sizes(self, tendons: int) -> tuple[int, ...]:
        """Return the sizes of its own dimensions."""
        return tuple(tendons if dim == "tendon" else len(LABELS[dim]) for dim in self.dims)


_SHAPE = {
    "tip": Variable(("xyz",), "m", "position of the tip in the base frame"),
    "tip_frame": Variable(("xyz", "column"), "1", "frame of the tip: columns t, n, b"),
    "tensions": Variable(("tendon",), "N", "tensions in tendon order"),
    "error": Variable((), "1", "estimated tip error over arm length"),
    "outcome": Variable((), "", "what happened", ""),
}
_SETTLED = {
    "settled": Variable((), "1", "whether the arm was settled as accurately as asked", False)
}
VARIABLES: Mapping[Compute, Mapping[str, Variable]] = {
    "settle": {**_SHAPE, **_SETTLED},
    "plan": {
        **_SHAPE,
        "effort": Variable((), "N", "norm of the tensions that was made least"),
        "reached": Variable((), "1", "whether the targets are met, by the certificate", False),
    },
    "stiffness": {
        **_SHAPE,
        **_SETTLED,
        "compliance": Variable(
            ("displacement", "wrench"),
            "m/N, m/(N m), rad/N, rad/(N m)",
            "displacement [m] and rotation [rad] per force [N] and moment [N m], base frame",
        ),
        "stable": Variable((), "1", "whether the shape is stable under held tensions", False),
    },
}
RESERVED = {
    "draw",
    "tendon",
    "zarr.json",
    *LABELS,
    *(n for item in VARIABLES.values() for n in item),
}
"""Names in a Dataset that no axis can have."""


def blank(compute: Compute, tendons: int, points: int) -> Rows:
    """Return rows in which nothing is computed yet; texts are objects, of any width."""
    return {
        name: np.full((points, *of.sizes(tendons)), of.blank, object if of.blank == "" else None)
        for name, of in VARIABLES[compute].items()
    }


# Points

SETTLED = "Settled."


@dataclass(frozen=True)
class Job:
    """What is the same for all points of a sweep, as workers need it.

    Attributes
    ----------
    compute
        What is computed at each point.
    scene : dict
        The scene with its defaults, as its file would hold it.
    name : str
        Of the file that the scene is from: others that it names are looked for from its folder.
    keys : tuple of str
        Key paths of what varies; a point is a value for each.
    tendons : tuple of str
        Names of the tendons.
    together : bool
        Whether only tensions vary of shapes in closed form, which are settled many at a time.
    objects : (SceneFile, SceneFile)
        Of a sweep of objects, the question of these, and that of the scene they are written as.
    """

    compute: Compute
    scene: dict[str, Any]
    name: str
    keys: tuple[str, ...]
    tendons: tuple[str, ...]
    together: bool
    objects: tuple[SceneFile, SceneFile] | None = None

    def question(self, point: Point = ()) -> SceneFile:
        """Return the question of a point; of the scene itself without a value for each key."""
        question = question_of(changed(self.scene, self.keys[: len(point)], point), self.name)
        return question if self.objects is None else unchanged(*self.objects, question)


def unchanged(original: Any, again: Any, new: Any) -> Any:
    """Return a new value, of which is `original` what is as in `again`.

    `again` is what the original is once it is written and read: a number in mm that is written has
    not always digits enough for the one in m.
    """
    if new == again:
        return original
    if not type(original) is type(again) is type(new):
        return new
    if isinstance(new, Scene):
        return Scene(*unchanged(original.effects, again.effects, new.effects))
    if is_dataclass(type(new)):
        names = arguments(type(new))
        parts = [[getattr(each, name) for name in names] for each in (original, again, new)]
        return type(new)(**dict(zip(names, map(unchanged, *parts), strict=True)))
    if isinstance(new, dict) and original.keys() == again.keys() == new.keys():
        return {key: unchanged(original[key], again[key], new[key]) for key in new}
    if isinstance(new, tuple | list) and len(original) == len(again) == len(new):
        return type(new)(map(unchanged, original, again, new))
    return new


def computed(job: Job, points: Sequence[Point]) -> Rows:
    """Return what is computed at points; one that fails is a row that says so."""
    with ProgressLine(False):
        parts = [_together(job, points)] if job.together else [_row(job, p) for p in points]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _row(job: Job, point: Point) -> Rows:
    """Return what is computed at a point. Whatever goes wrong there is told, and ends nothing."""
    values: dict[str, Any] = {}
    try:
        question = job.question(point)
        if question.arm.n_tendons != len(job.tendons):
            allowed = f"{len(job.tendons)}, as the scene's own arm has"
            raise InputError("number of tendons", question.arm.n_tendons, allowed)
        values = _values(job.compute, question)
    except Exception as reason:
        kind = "" if isinstance(reason, OctoplanError) else f"{type(reason).__name__}: "
        values["outcome"] = f"Failed: {kind}{reason}"
    # A point that the time limit of the whole sweep has cut short is computed another time.
    check_time()
    row = blank(job.compute, len(job.tendons), 1)
    for name, value in values.items():
        row[name][0] = value
    return row


def _values(compute: Compute, question: SceneFile) -> dict[str, Any]:
    """Return what is computed of a question, by the names of the variables."""
    names = ("tip", "tip_frame", "tensions", "error")
    if compute == "plan":
        p = planned(question)
        values: dict[str, Any] = {"effort": p.effort, "reached": p.reached}
        # Where the tensions do not settle, the certificate says so and the outcome tells it.
        with suppress(OctoplanError):
            values |= {name: getattr(p.shape, name) for name in names}
        return values | {"tensions": np.ravel(p.tensions), "outcome": p.outcome}
    values = {"settled": True, "outcome": SETTLED}
    if compute == "settle":
        shape = settled(question)
    else:
        with limited(question.time_limit):
            k = stiff(question)
            values |= {"stable": k.stable, "compliance": k.compliance}
        shape = k.shape
    return values | {name: getattr(shape, name) for name in names}


def _together(job: Job, points: Sequence[Point]) -> Rows:
    """Return what is computed at sets of tensions of one arm, which are settled at once."""
    question = job.question()
    flat, read = question.arm.flat(question.tensions), question.arm.flat
    # Which tendon has its tension at each key path: the one whose tension is the largest there.
    marked = (
        changed({"tensions": question.tensions}, [key], [flat.max() + 1.0]) for key in job.keys
    )
    T = np.repeat(flat[None], len(points), axis=0)
    T[:, [int(np.argmax(read(each["tensions"]))) for each in marked]] = points
    arguments = (question.arm, T, question.scene, question.accuracy)
    options = {"compile": question.options["compile"], "time_limit": question.time_limit}
    many = settle_many(*arguments, errors="nan", **options)
    failed = {i: _row(job, points[i]) for i, text in enumerate(many.problems) if text}
    rows = blank(job.compute, len(job.tendons), len(points))
    shapes = {name: getattr(many, name) for name in ("tip", "tip_frame", "error")}
    rows |= shapes | {"tensions": T}
    rows["settled"][:], rows["outcome"][:] = True, SETTLED
    for i, row in failed.items():
        for name, values in row.items():
            rows[name][i] = values[0]
    return rows
