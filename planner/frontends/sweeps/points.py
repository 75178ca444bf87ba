"""The computation at the points of a sweep, and the arrays of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

import numpy as np

from octoplan.model import InputError, OctoplanError, settle_many
from octoplan.model.scene import Scene
from octoplan.model.support.progress import ProgressLine, check_time, limited
from octoplan.planner.extensions.base_joints.joints import BasePosition
from octoplan.planner.frontends.io.calls import run_plan, run_settle, run_stiffness
from octoplan.planner.frontends.io.codec import arguments
from octoplan.planner.frontends.io.key_paths import changed
from octoplan.planner.frontends.io.scene_file import SceneFile, question_of
from octoplan.planner.frontends.sweeps.work import Point, Rows

Compute = Literal["settle", "plan", "stiffness"]

LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "displacement": ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z"],
    "wrench": ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"],
}


@dataclass(frozen=True)
class Variable:
    """A result of a point.

    Attributes
    ----------
    dims : tuple of str
        Dimensions of the variable besides those of the grid of points.
    units, about : str
    blank : float, bool or str
        Value for points that failed.
    """

    dims: tuple[str, ...]
    units: str
    about: str
    blank: Any = np.nan

    def sizes(self, tendons: int) -> tuple[int, ...]:
        """Return the sizes of the dimensions `dims`."""
        return tuple(tendons if dim == "tendon" else len(LABELS[dim]) for dim in self.dims)


_SHAPE = {
    "tip": Variable(("xyz",), "m", "position of the tip in the base frame"),
    "tip_frame": Variable(("xyz", "column"), "1", "frame of the tip: columns t, n, b"),
    "tensions": Variable(("tendon",), "N", "tensions in tendon order"),
    "error": Variable((), "1", "estimated tip error over arm length"),
    "outcome": Variable((), "", "what happened", ""),
}
_SETTLED = {"settled": Variable((), "1", "whether the shape meets the accuracy", False)}
VARIABLES: Mapping[Compute, Mapping[str, Variable]] = {
    "settle": {**_SHAPE, **_SETTLED},
    "plan": {
        **_SHAPE,
        "effort": Variable((), "N", "minimised norm of the tensions"),
        "reached": Variable((), "1", "whether the targets are met, by the certificate", False),
        "insertion": Variable((), "m", "insertion of the base, 0 for a fixed base"),
        "rotation": Variable((), "rad", "rotation of the base, 0 for a fixed base"),
    },
    "stiffness": {
        **_SHAPE,
        **_SETTLED,
        "compliance": Variable(
            ("displacement", "wrench"),
            "m/N, m/(N m), rad/N, rad/(N m)",
            "displacement [m] and rotation [rad] per force [N] and moment [N m], base frame",
        ),
        "stable": Variable((), "1", "whether the shape is stable under constant tensions", False),
    },
}
RESERVED = {
    "draw",
    "tendon",
    "zarr.json",
    *LABELS,
    *(n for item in VARIABLES.values() for n in item),
}
"""Names in a Dataset that are not allowed for axes."""


def blank(compute: Compute, tendons: int, points: int) -> Rows:
    """Return rows of blank values; texts have dtype object, for any length."""
    return {
        name: np.full((points, *of.sizes(tendons)), of.blank, object if of.blank == "" else None)
        for name, of in VARIABLES[compute].items()
    }


# Points

SETTLED = "Settled."


@dataclass(frozen=True)
class Job:
    """The part of a sweep that all points share; sent to workers.

    Attributes
    ----------
    compute
        The computation at each point.
    scene : dict
        The scene with defaults, as decoded from a file.
    name : str
        Path of the scene file; mesh files are relative to this folder.
    keys : tuple of str
        Key paths of the axes; a point has a value for each.
    tendons : tuple of str
        Names of the tendons.
    together : bool
        Whether only tensions of closed-form shapes vary: these are settled in batches.
    objects : (SceneFile, SceneFile)
        For a sweep of objects: the given objects, and the same objects encoded and decoded.
    """

    compute: Compute
    scene: dict[str, Any]
    name: str
    keys: tuple[str, ...]
    tendons: tuple[str, ...]
    together: bool
    objects: tuple[SceneFile, SceneFile] | None = None

    def question(self, point: Point = ()) -> SceneFile:
        """Return the scene at a point; by default, the scene without changes."""
        question = question_of(changed(self.scene, self.keys[: len(point)], point), self.name)
        return question if self.objects is None else restore(*self.objects, question)

    def rows(self, points: Sequence[Point]) -> Rows:
        """Return the results at points; a point that fails has the error as `outcome`."""
        with ProgressLine(False):
            parts = (
                [_compute_batch(self, points)]
                if self.together
                else [_compute_point(self, point) for point in points]
            )
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def restore(original: Any, decoded: Any, new: Any) -> Any:
    """Return `new` with all parts that are equal in `decoded` replaced by parts of `original`.

    `decoded` is the original after encoding and decoding, which may change the last digit of
    numbers in mm.
    """
    if new == decoded:
        return original
    if not type(original) is type(decoded) is type(new):
        return new
    if isinstance(new, Scene):
        return Scene(*restore(original.effects, decoded.effects, new.effects))
    if is_dataclass(type(new)):
        names = arguments(type(new))
        parts = [[getattr(each, name) for name in names] for each in (original, decoded, new)]
        return type(new)(**dict(zip(names, map(restore, *parts), strict=True)))
    if isinstance(new, dict) and original.keys() == decoded.keys() == new.keys():
        return {key: restore(original[key], decoded[key], new[key]) for key in new}
    if isinstance(new, tuple | list) and len(original) == len(decoded) == len(new):
        return type(new)(map(restore, original, decoded, new))
    return new


def _compute_point(job: Job, point: Point) -> Rows:
    """Return the result at a point; any error becomes the `outcome` of the point."""
    values: dict[str, Any] = {}
    try:
        question = job.question(point)
        if question.arm.n_tendons != len(job.tendons):
            allowed = f"{len(job.tendons)}, as in the scene"
            raise InputError("number of tendons", question.arm.n_tendons, allowed)
        values = _values(job.compute, question)
    except Exception as reason:
        kind = "" if isinstance(reason, OctoplanError) else f"{type(reason).__name__}: "
        values["outcome"] = f"Failed: {kind}{reason}"
    # A point that the time limit of the whole sweep cuts off is not a result.
    check_time()
    row = blank(job.compute, len(job.tendons), 1)
    for name, value in values.items():
        row[name][0] = value
    return row


def _values(compute: Compute, question: SceneFile) -> dict[str, Any]:
    """Return the results for a scene, by name of variable."""
    names = ("tip", "tip_frame", "tensions", "error")
    if compute == "plan":
        p = run_plan(question)
        values: dict[str, Any] = {"effort": p.effort, "reached": p.reached}
        # Without an equilibrium, the outcome has the reason.
        with suppress(OctoplanError):
            values |= {name: getattr(p.shape, name) for name in names}
        values |= (p.base or BasePosition())._asdict()
        return values | {"tensions": np.ravel(p.tensions), "outcome": p.outcome}
    values = {"settled": True, "outcome": SETTLED}
    if compute == "settle":
        shape = run_settle(question)
    else:
        with limited(question.time_limit):
            k = run_stiffness(question)
            values |= {"stable": k.stable, "compliance": k.compliance}
        shape = k.shape
    return values | {name: getattr(shape, name) for name in names}


def _compute_batch(job: Job, points: Sequence[Point]) -> Rows:
    """Return the results at sets of tensions of one arm, settled as a batch."""
    question = job.question()
    flat = question.arm.flat(question.tensions)
    read = question.arm.flat
    # Find the tendon of each key path: mark the path with the largest tension.
    marked = (
        changed({"tensions": question.tensions}, [key], [flat.max() + 1.0]) for key in job.keys
    )
    T = np.repeat(flat[None], len(points), axis=0)
    T[:, [int(np.argmax(read(each["tensions"]))) for each in marked]] = points
    many = settle_many(
        question.arm,
        T,
        question.scene,
        accuracy=question.accuracy,
        compile=question.options["compile"],
        errors="nan",
        time_limit=question.time_limit,
    )
    failed = {i: _compute_point(job, points[i]) for i, text in enumerate(many.problems) if text}
    rows = blank(job.compute, len(job.tendons), len(points))
    shapes = {name: getattr(many, name) for name in ("tip", "tip_frame", "error")}
    rows |= shapes | {"tensions": T}
    rows["settled"][:] = True
    rows["outcome"][:] = SETTLED
    for i, row in failed.items():
        for name, values in row.items():
            rows[name][i] = values[0]
    return rows
