"""What is computed at the points of a sweep, each on its own: none depends on another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import InputError, OctoplanError, settle, settle_many
from model.progress import listening
from model.stiffness import stiffness
from model.time_limit import OutOfTime, check_time, limited
from planner.io.key_paths import changed
from planner.io.scene_file import Question, question_of
from planner.plan import plan
from planner.sweeps.definition import Point, Sweep
from planner.sweeps.tables import Compute
from planner.sweeps.variables import Rows, blank

SETTLED = "Settled."


@dataclass(frozen=True)
class Job:
    """What is the same for all points of a sweep, as workers need it; see Sweep."""

    compute: Compute
    scene: dict[str, Any]
    name: str
    keys: tuple[str, ...]
    tendons: int
    together: bool

    @classmethod
    def of(cls, sweep: Sweep) -> Job:
        """Return the job of a sweep."""
        own = (sweep.compute, sweep.scene, sweep.name, sweep.keys)
        return cls(*own, len(sweep.tendons), sweep.together)


def computed(job: Job, points: Sequence[Point]) -> Rows:
    """Return what is computed at points; one that fails is a row that says so."""
    with listening(None):
        if job.together:
            return _together(job, points)
        rows = [_row(job, point) for point in points]
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def _row(job: Job, point: Point) -> Rows:
    """Return what is computed at a point. Whatever goes wrong there is told, and ends nothing."""
    values: dict[str, Any] = {}
    try:
        question = question_of(changed(job.scene, job.keys, point), job.name)
        if question.arm.n_tendons != job.tendons:
            allowed = f"{job.tendons}, as the scene's own arm has"
            raise InputError("number of tendons", question.arm.n_tendons, allowed)
        values = _COMPUTE[job.compute](question)
    except OutOfTime:
        raise
    except OctoplanError as reason:
        values["outcome"] = f"Failed: {reason}"
    except Exception as reason:
        values["outcome"] = f"Failed: {type(reason).__name__}: {reason}"
    # A point that the time limit of the whole sweep has cut short is computed another time.
    check_time()
    row = blank(job.compute, job.tendons, 1, len(values["outcome"]))
    for name, value in values.items():
        row[name][0] = value
    return row


def _settle(question: Question) -> dict[str, Any]:
    given = (question.arm, question.tensions, question.scene, question.accuracy)
    with limited(question.time_limit):
        shape = settle(*given, compile=question.compile, **question.winches)
    return _shape(shape) | {"settled": True, "outcome": SETTLED}


def _plan(question: Question) -> dict[str, Any]:
    options = {
        **question.options,
        "accuracy": question.accuracy,
        "compile": question.compile,
        "time_limit": question.time_limit,
    }
    result = plan(question.arm, question.targets, question.scene, **options)
    values: dict[str, Any] = {"effort": result.effort, "reached": result.reached}
    # Where the tensions do not settle, the certificate says so and the outcome tells it.
    with suppress(OctoplanError):
        values |= _shape(result.shape)
    return values | {"tensions": np.ravel(result.tensions), "outcome": result.outcome}


def _stiffness(question: Question) -> dict[str, Any]:
    options = {**question.stiffness, **question.winches, "compile": question.compile}
    given = (question.arm, question.tensions, question.scene)
    with limited(question.time_limit):
        result = stiffness(*given, accuracy=question.accuracy, **options)
        found = {"stable": result.stable, "compliance": result.compliance}
    return _shape(result.shape) | found | {"settled": True, "outcome": SETTLED}


def _shape(shape: Any) -> dict[str, Any]:
    return {name: getattr(shape, name) for name in ("tip", "tip_frame", "tensions", "error")}


_COMPUTE: dict[Compute, Callable[[Question], dict[str, Any]]] = {
    "settle": _settle,
    "plan": _plan,
    "stiffness": _stiffness,
}


def _together(job: Job, points: Sequence[Point]) -> Rows:
    """Return what is computed at sets of tensions of one arm, which are settled at once."""
    question = question_of(job.scene, job.name)
    T = np.repeat(question.arm.flat(question.tensions)[None], len(points), axis=0)
    T[:, [_column(question, key) for key in job.keys]] = points
    given = (question.arm, T, question.scene, question.accuracy)
    many = settle_many(*given, compile=question.compile, errors="nan")
    failed = {i: _row(job, points[i]) for i, told in enumerate(many.problems) if told}
    width = max([len(SETTLED), *(row["outcome"].dtype.itemsize // 4 for row in failed.values())])
    rows = blank(job.compute, job.tendons, len(points), width)
    shapes = {name: getattr(many, name) for name in ("tip", "tip_frame", "error")}
    rows |= shapes | {"tensions": T}
    rows["settled"][:], rows["outcome"][:] = True, SETTLED
    for i, row in failed.items():
        for name, values in row.items():
            rows[name][i] = values[0]
    return rows


def _column(question: Question, key: str) -> int:
    """Return which tendon, in tendon order, has its tension at a key path."""
    given = question.tensions
    zeros = [[0.0] * len(row) if isinstance(row, list) else 0.0 for row in given]
    marked = changed({"tensions": zeros}, [key], [1.0])["tensions"]
    return int(np.argmax(question.arm.flat(marked)))
