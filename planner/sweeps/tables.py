"""The tables of sweep files: a scene, what to find of it, and the axes along which it varies."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from model.quantities import Positive
from planner.io.codec import Table
from planner.io.scene_tables import SceneKey

Compute = Literal["settle", "plan", "stiffness"]
Distribution = Literal["uniform", "normal", "log-uniform"]
Values = Annotated[list[float | int | str | bool], Meta(min_length=1)]
MOST_POINTS = 10_000_000
Count = Annotated[int, Meta(ge=1, le=MOST_POINTS)]


class AxisTable(Table, frozen=True):
    """A value of the scene that varies: by `values`, by start, stop and count, or drawn."""

    key: Annotated[str, Meta(description="key path of the scene's value: tensions[0][2]")]
    name: Annotated[str | None, Meta(description="in the Dataset; the key unless given")] = None
    values: Annotated[
        Values | None,
        Meta(description="a grid: these values"),
    ] = None
    start: Annotated[float | None, Meta(description="a grid: the first of count values")] = None
    stop: Annotated[float | None, Meta(description="a grid: the last of them")] = None
    count: Annotated[Count | None, Meta(description="a grid: how many, evenly spaced")] = None
    distribution: Annotated[Distribution | None, Meta(description="drawn at random")] = None
    low: Annotated[float | None, Meta(description="the least that is drawn")] = None
    high: Annotated[float | None, Meta(description="the most that is drawn")] = None
    mean: Annotated[float | None, Meta(description="of a normal distribution")] = None
    sd: Annotated[Positive | None, Meta(description="standard deviation of a normal one")] = None


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
