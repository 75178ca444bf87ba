"""Results as CSV: what winches are driven by, tendon by tendon, and shapes along the arm."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from model import Arm, Shape
from model.checks import within
from planner.io.codec import number_in
from planner.io.files import write_named
from planner.io.records import POINTS, of_shape

_FRAME = [f"{column}_{axis}" for column in "tnb" for axis in "xyz"]
SHAPE_COLUMNS = ("s_m", "x_m", "y_m", "z_m", *_FRAME, "tau_1_m", "xi_1_m", "k_1_m", "q")
PLAN_COLUMNS = ("section", "tendon", "tension_N", "length_mm", "stroke_mm", "state")


def _lines(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([repr(x) if isinstance(x, float) else x for x in row] for row in rows)
    return text.getvalue().encode()


def shape_csv(shape: Shape, points: int = POINTS) -> bytes:
    """Return a shape as CSV: a line of names, then one for each of many evenly spaced stations.

    Arc length and position [m], the frame's columns t, n, b, strains tau, xi, k [1/m] and q.
    """
    within("points", points, 2, 1_000_000)
    s = np.linspace(0.0, shape.arm.length, points)
    frames = np.swapaxes(shape.frame(s), 1, 2).reshape(points, 9)
    rows = np.column_stack([s, shape.position(s), frames, shape.strain(s)])
    return _lines(SHAPE_COLUMNS, rows.tolist())


def save_shape(shape: Shape, path: str | Path, points: int = POINTS) -> Path:
    """Write a shape to a .csv file, whole or not at all; see shape_csv for its columns.

    Raises InputError for another suffix, and where it cannot be written.
    """
    return write_named(path, ".csv", shape_csv(shape, points))


def plan_csv(plan: Any) -> bytes:
    """Return a plan as CSV, what one drives the arm by: a line of names, then a tendon a line.

    Section and tendon by their names, tension [N], the length that the winch leaves between base
    and anchorage [mm], the stroke that it has taken in [mm], and whether the tendon is taut or
    slack. Lengths and strokes are empty where the statics have none, or the tensions do not settle.
    """
    arm, tensions = plan.arm, np.ravel(plan.tensions).tolist()
    shape = of_shape(plan)
    slack = [T <= 0 for T in tensions] if shape["slack"] is None else shape["slack"].ravel()
    lengths, strokes = _mm(arm, shape["lengths_m"]), _mm(arm, shape["strokes_m"])
    states = ["slack" if item else "taut" for item in slack]
    sections = [section + 1 for section, _ in arm.tendons]
    rows = zip(sections, arm.tendon_names, tensions, lengths, strokes, states, strict=True)
    return _lines(PLAN_COLUMNS, rows)


def _mm(arm: Arm, lengths: Any) -> list[Any]:
    """Return lengths of tendons [m] in mm; empty cells for none."""
    none = [""] * arm.n_tendons
    return none if lengths is None else [number_in(x, "mm") for x in np.ravel(lengths).tolist()]
