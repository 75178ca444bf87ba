"""A settled shape as a record, and as a table of stations along the arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from model import Shape
from model.checks import within
from planner.files import versions, write_named
from planner.tendon_lengths import strokes

POINTS = 101
_FRAME = [f"{column}_{axis}" for column in "tnb" for axis in "xyz"]
COLUMNS = ("s_m", "x_m", "y_m", "z_m", *_FRAME, "tau_1_m", "xi_1_m", "k_1_m", "q")


class ShapeRecord(msgspec.Struct, kw_only=True):
    """A settled shape."""

    schema: Annotated[Literal["octoplan shape 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    tip_m: list[float]
    tip_frame: Annotated[list[list[float]], Meta(description="columns t, n, b")]
    tensions_N: Annotated[Any, Meta(description="a row a section, tip first, or flat")]
    error: Annotated[float, Meta(description="estimated tip error over arm length")]
    tendon_lengths_m: Annotated[list[float], Meta(description="in tendon order")]
    strokes_m: Annotated[list[float], Meta(description="taken in from the straight arm at rest")]
    slack: Annotated[list[bool], Meta(description="in tendon order")]
    s_m: Annotated[list[float], Meta(description="arc lengths from the base")]
    position_m: Annotated[list[list[float]], Meta(description="at s_m")]
    strain: Annotated[list[list[float]], Meta(description="tau, xi, k [1/m] and q [-] at s_m")]


def shape_record(shape: Shape) -> ShapeRecord:
    """Return the record of a settled shape."""
    s = np.linspace(0.0, shape.arm.length, POINTS)
    return ShapeRecord(
        schema="octoplan shape 1",
        versions=versions(),
        tip_m=shape.tip.tolist(),
        tip_frame=shape.tip_frame.tolist(),
        tensions_N=shape.arm.by_section(shape.tensions).tolist(),
        error=float(shape.error),
        tendon_lengths_m=shape.tendon_lengths.tolist(),
        strokes_m=strokes(shape).tolist(),
        slack=shape.slack.ravel().tolist(),
        s_m=s.tolist(),
        position_m=shape.position(s).tolist(),
        strain=shape.strain(s).tolist(),
    )


def shape_csv(shape: Shape, points: int = POINTS) -> bytes:
    """Return a shape as CSV: a line of names, then one for each of many evenly spaced stations.

    Arc length and position [m], the frame's columns t, n, b, strains tau, xi, k [1/m] and q.
    """
    within("points", points, 2, 1_000_000)
    s = np.linspace(0.0, shape.arm.length, points)
    frames = np.swapaxes(shape.frame(s), 1, 2).reshape(points, 9)
    rows = np.column_stack([s, shape.position(s), frames, shape.strain(s)])
    lines = [",".join(COLUMNS), *(",".join(map(repr, row)) for row in rows.tolist())]
    return ("\n".join(lines) + "\n").encode()


def save_shape(shape: Shape, path: str | Path, points: int = POINTS) -> Path:
    """Write a shape to a .csv file, whole or not at all; see shape_csv for its columns.

    Raises InputError for another suffix, and where it cannot be written.
    """
    return write_named(path, ".csv", shape_csv(shape, points))
