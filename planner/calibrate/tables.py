"""The tables of calibration files."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from planner.scenes.keys import Accuracy, NotNegative, Positive, Table, Vector
from planner.unknowns.tables import UnknownTable


class PointTable(Table, frozen=True):
    """A marker on the arm, by its name in the columns of the measured shapes."""

    name: str
    s_mm: Annotated[NotNegative, Meta(description="arc length from the base [mm]")]
    offset_mm: Annotated[
        Vector, Meta(description="from the midline in the local frame t, n, b [mm]")
    ] = (0.0, 0.0, 0.0)


class CalibrationFile(Table, frozen=True):
    """A calibration file: a scene, measured shapes, and what is unknown."""

    scene: Annotated[
        str | dict[str, Any], Meta(description="a scene file, from this file's folder; or a table")
    ]
    measured: Annotated[str, Meta(description="a CSV file of shapes, from this file's folder")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    points: Annotated[tuple[PointTable, ...], Meta(description="the markers")] = ()
    std_mm: Annotated[Positive, Meta(description="standard deviation of places [mm]")] = 1.0
    absolute_std: Annotated[bool, Meta(description="whether that holds as it is")] = False
    loss: Annotated[
        Literal["linear", "huber", "soft_l1", "cauchy"], Meta(description="robust unless linear")
    ] = "linear"
    starts: Annotated[int, Meta(ge=1, le=1000, description="how many fits begin")] = 1
    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-5
