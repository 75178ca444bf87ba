"""What a worker does: points of a sweep, each on its own, so that none depends on another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import Arm, InputError, OctoplanError, settle, settle_many
from model.paths import Array
from model.progress import listening
from model.stiffness import stiffness
from model.time_limit import OutOfTime, check_time
from planner.plan import plan
from planner.scenefile import Question, question_of
from planner.sweeps.keys import changed
from planner.sweeps.tables import Compute
from planner.sweeps.variables import Rows, blank

Point = tuple[Any, ...]
SETTLED = "Settled."


@dataclass(frozen=True)
class Job:
    """What is the same for all points of a sweep.

    Attributes
    ----------
    compute
        What is found at each point.
    scene : dict
        The scene, as its file would hold it.
    keys : tuple of str
        Key paths of what varies; a point is a value for each.
    tendons : int
        Of the arm.
    together : bool
        Whether only tensions vary of shapes in closed form, which are settled many at a time.
    """

    compute: Compute
    scene: dict[str, Any]
    keys: tuple[str, ...]
    tendons: int
    together: bool


def run(job: Job, points: Sequence[Point]) -> Rows:
    """Return what is found at points; one that fails is a row that says so."""
    with listening(None):
        rows = blank(job.compute, job.tendons, len(points))
        if job.together:
            _settle_together(job, points, rows)
        else:
            for i, point in enumerate(points):
                rows.put(i, _alone(job, point))
        return rows


def _alone(job: Job, point: Point) -> Rows:
    row = blank(job.compute, job.tendons, 1)

    def find() -> str:
        asked = question_of(changed(job.scene, job.keys, point))
        if asked.arm.n_tendons != job.tendons:
            allowed = f"{job.tendons}, as the scene's own arm has"
            raise InputError("number of tendons", asked.arm.n_tendons, allowed)
        return _FIND[job.compute](asked, {name: own[0, ...] for name, own in row.values.items()})

    row.outcomes[0] = _told(find)
    # What the time limit has cut short is found another time.
    check_time()
    return row


def _told(find: Callable[[], str]) -> str:
    """Return what happened. Whatever goes wrong at a point is told there and ends nothing."""
    try:
        return find()
    except OutOfTime:
        raise
    except OctoplanError as reason:
        return f"Failed: {reason}"
    except Exception as reason:
        return f"Failed: {type(reason).__name__}: {reason}"


def _settle(asked: Question, row: dict[str, Array]) -> str:
    given = (asked.arm, asked.tensions, asked.scene, asked.accuracy)
    shape = settle(*given, compile=asked.compile, **asked.winches)
    row["tensions"][...] = shape.tensions
    _keep_shape(shape, row)
    row["settled"][...] = True
    return SETTLED


def _plan(asked: Question, row: dict[str, Array]) -> str:
    options = {**asked.options, "accuracy": asked.accuracy, "compile": asked.compile}
    found = plan(asked.arm, asked.targets, asked.scene, time_limit=asked.time_limit, **options)
    row["tensions"][...] = np.ravel(found.tensions)
    row["effort"][...] = found.effort
    row["reached"][...] = found.reached
    # Where the tensions do not settle, the certificate has found so and the outcome tells it.
    with suppress(OctoplanError):
        _keep_shape(found.shape, row)
    return found.outcome


def _stiffness(asked: Question, row: dict[str, Array]) -> str:
    options = {**asked.stiffness, **asked.winches, "compile": asked.compile}
    found = stiffness(asked.arm, asked.tensions, asked.scene, accuracy=asked.accuracy, **options)
    row["tensions"][...] = found.shape.tensions
    _keep_shape(found.shape, row)
    row["settled"][...] = True
    row["stable"][...] = found.stable
    row["compliance"][...] = found.compliance
    return SETTLED


def _keep_shape(shape: Any, row: dict[str, Array]) -> None:
    row["tip"][...], row["tip_frame"][...], row["error"][...] = (
        shape.tip,
        shape.tip_frame,
        shape.error,
    )


_FIND: dict[Compute, Callable[[Question, dict[str, Array]], str]] = {
    "settle": _settle,
    "plan": _plan,
    "stiffness": _stiffness,
}


def _settle_together(job: Job, points: Sequence[Point], rows: Rows) -> None:
    asked = question_of(job.scene)
    T = np.repeat(asked.arm.flat(asked.tensions)[None], len(points), axis=0)
    T[:, [_column(asked.arm, asked.tensions, key) for key in job.keys]] = points
    _settle_range(asked, T, rows, lambda i: _alone(job, points[i]), 0, len(points))


def _settle_range(
    asked: Question, T: Array, rows: Rows, alone: Callable[[int], Rows], begin: int, end: int
) -> None:
    """Settle sets of tensions at once; where one fails, each half on its own."""
    if end - begin == 1:
        rows.put(begin, alone(begin))
        return
    try:
        given = (asked.arm, T[begin:end], asked.scene, asked.accuracy)
        found = settle_many(*given, compile=asked.compile)
    except OctoplanError:
        middle = (begin + end) // 2
        _settle_range(asked, T, rows, alone, begin, middle)
        _settle_range(asked, T, rows, alone, middle, end)
        return
    told = [SETTLED] * (end - begin)
    values = {"tip": found.tip, "tip_frame": found.tip_frame, "error": found.error}
    flags = {"tensions": T[begin:end], "settled": np.ones(end - begin)}
    rows.put(begin, Rows({**values, **flags}, told))


def _column(arm: Arm, tensions: Any, key: str) -> int:
    """Return which tendon, in tendon order, has its tension at a key path."""
    zeros = [[0.0] * len(row) if isinstance(row, list) else 0.0 for row in tensions]
    marked = changed({"tensions": zeros}, [key], [1.0])["tensions"]
    return int(np.argmax(arm.flat(marked)))
