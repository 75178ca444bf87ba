"""What is asked of a motion: its targets, how fast tensions and strokes may change, when."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import finite_array, positive
from model.errors import FileError, InputError
from model.paths import Array
from model.units import warn_of_strokes
from planner.targets import TipPosition
from planner.targets.base import Target

_AXES = ("x_m", "y_m", "z_m")
Targets = tuple[tuple[Target, ...], ...]


@dataclass(frozen=True)
class Rates:
    """How fast tensions and strokes may change.

    Attributes
    ----------
    tension : (n_tendons,)
        [N/s], infinite where there is no limit.
    stroke : float
        [m/s], of every tendon.
    acceleration : float
        Of every stroke [m/s2]; where it is limited, motions rest at each waypoint.
    """

    tension: tuple[float, ...]
    stroke: float = np.inf
    acceleration: float = np.inf

    @classmethod
    def of(cls, arm: Arm, tension: Any, stroke: Any, acceleration: Any = None) -> Rates:
        """Return the rates of an arm; None is no limit. InputError for what is none."""
        if tension is None:
            tension = np.full(arm.n_tendons, np.inf)
        elif np.ndim(tension) == 0:
            tension = np.full(arm.n_tendons, positive("rate_max", tension))
        else:
            tension = arm.flat(tension, "rate_max")
            if not tension.min() > 0:
                raise InputError("rate_max", tension.tolist(), "numbers above 0 N/s")
        given = {"stroke_rate_max": stroke, "stroke_acceleration_max": acceleration}
        most = [np.inf if own is None else positive(key, own) for key, own in given.items()]
        warn_of_strokes("stroke_rate_max", [most[0] / arm.length])
        return cls(tuple(np.asarray(tension).tolist()), *most)

    @property
    def limited(self) -> bool:
        """Whether every motion takes time."""
        strokes = np.isfinite(self.stroke) or np.isfinite(self.acceleration)
        return bool(np.all(np.isfinite(self.tension))) or bool(strokes)

    @property
    def pace(self) -> float:
        """The rate of strokes that the program over the waypoints counts with [m/s].

        Where only accelerations are limited, any: durations are theirs then.
        """
        free = not np.isfinite(self.stroke) and np.isfinite(self.acceleration)
        return 1.0 if free and not np.all(np.isfinite(self.tension)) else self.stroke


def waypoints_of(path: Any, count: int) -> tuple[list[Any], Array | None]:
    """Return the targets of a path in order, and the times of a file that has them.

    Parameters
    ----------
    path : sequence of targets, function, or name of a .csv file
        A function takes a share from 0 to 1 and returns a target, or a place (3,) [m] for the tip;
        it is asked `count` times. A file has columns x_m, y_m, z_m and, if it has, t_s.

    Raises
    ------
    InputError
        For what is none of these, and no targets; FileError with the place in a file.
    """
    if isinstance(path, str | Path):
        return _read(Path(path))
    if callable(path):
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise InputError("waypoints", count, "a whole number from 1")
        return [_target(path(float(share))) for share in np.linspace(0, 1, count)], None
    if not isinstance(path, Iterable):
        raise InputError(
            "targets", path, "targets in order, a function, or the name of a .csv file"
        )
    found = list(path)
    if not found:
        raise InputError("targets", found, "at least one target")
    return found, None


def _target(found: Any) -> Any:
    return found if hasattr(found, "terms") else TipPosition(found)


def _read(path: Path) -> tuple[list[Any], Array | None]:
    """Return the targets and times of a .csv file."""
    try:
        rows = list(csv.DictReader(path.read_text().splitlines()))
    except (OSError, UnicodeDecodeError) as reason:
        raise FileError(str(path), "", f"cannot be read: {reason}") from None
    if not rows:
        raise FileError(str(path), "", f"no lines below a heading {', '.join(_AXES)}")
    timed = "t_s" in rows[0]
    names = [*_AXES, *["t_s"] * timed]
    numbers = np.zeros((len(rows), len(names)))
    for i, row in enumerate(rows):
        for k, name in enumerate(names):
            try:
                numbers[i, k] = float(row.get(name) or "")
            except ValueError:
                told = f"got {row.get(name)!r}, allowed is a number"
                raise FileError(str(path), f"line {i + 2}, {name}", told) from None
    return [TipPosition(tuple(row[:3])) for row in numbers], numbers[:, 3] if timed else None


def checked_times(times: Any, count: int) -> Array | None:
    """Return the time of each target [s], increasing from above 0; None for None."""
    if times is None:
        return None
    found = finite_array("times", times, (count,))
    steps = np.diff(found, prepend=0.0)
    if steps.min() <= 0:
        worst = int(np.argmin(steps))
        allowed = "times above 0 that increase, one for each target"
        raise InputError(f"times[{worst}]", float(found[worst]), allowed)
    return found
