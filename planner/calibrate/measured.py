"""What was measured of one shape of an arm."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from model import Arm, InputError
from model.checks import finite_array, positive
from model.paths import Array

_ORTHONORMAL = 1e-3
# Markers farther from the base than this, in arm lengths and offsets, cannot be on the arm.
_FAR, _TINY = 1.5, 1 / 300


class Point(NamedTuple):
    """A marker: arc length [m], offset in the local frame (t, n, b) [m], place [m] if seen."""

    s: float
    offset: tuple[float, ...]
    place: tuple[float, ...] | None


class MeasuredFrame(NamedTuple):
    """A frame at an arc length [m]: columns t, n, b in the base frame (3, 3), row by row."""

    s: float
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Measured:
    """One measured shape, in SI units and the coordinates in which the arm's base is given.

    Attributes
    ----------
    tensions : (n_tendons,) or by section
        [N].
    points : sequence of (s, offset, place)
        Markers: arc length [m], offset from the midline in the local frame (t, n, b) [m], measured
        place (3,) [m], or None where a marker was not seen.
    frames : sequence of (s, matrix)
        Measured frames (3, 3), columns t, n, b.
    tip : (3,)
        Measured place of the tip [m].
    lengths : (n_tendons,)
        Measured lengths of the tendons from base to anchorage [m].
    strokes : (n_tendons,)
        What was taken in of them from the straight arm at rest [m].
    session : str
        Shapes of a session share its unknowns.
    name : str
        Of the shape, in reports.
    std : float
        Standard deviation of places, lengths and strokes [m]; of shapes against each other, unless
        `calibrate` is told that it holds as it is.
    angle_std : float
        Standard deviation of frames [rad].
    """

    tensions: Any
    points: Sequence[Any] = ()
    frames: Sequence[Any] = ()
    tip: Any = None
    lengths: Any = None
    strokes: Any = None
    session: str = ""
    name: str = ""
    std: float = 1e-3
    angle_std: float = 1e-2

    def __post_init__(self) -> None:
        points = tuple(_point(i, given) for i, given in enumerate(self.points))
        frames = tuple(_frame(i, given) for i, given in enumerate(self.frames))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "frames", frames)
        for name in ("tip", "lengths", "strokes"):
            given = getattr(self, name)
            if given is not None:
                size = 3 if name == "tip" else None
                kept = finite_array(f"Measured.{name}", given, (size,))
                object.__setattr__(self, name, tuple(kept.tolist()))
        for name in ("std", "angle_std"):
            object.__setattr__(self, name, positive(f"Measured.{name}", getattr(self, name)))
        if not self.size:
            allowed = "points, frames, a tip, lengths or strokes"
            raise InputError(f"Measured {self.name}".rstrip(), "nothing", allowed)

    @property
    def seen(self) -> list[tuple[int, Point]]:
        """The points that were seen, by their number."""
        return [(i, point) for i, point in enumerate(self.points) if point.place is not None]

    @property
    def places(self) -> Array:
        """The places of the points that were seen (n, 3) [m]."""
        return np.array([point.place for _, point in self.seen], dtype=float).reshape(-1, 3)

    @property
    def size(self) -> int:
        """How many numbers were measured."""
        ends = 3 * (len(self.seen) + len(self.frames) + (self.tip is not None))
        return ends + len(self.lengths or ()) + len(self.strokes or ())

    @property
    def stds(self) -> Array:
        """Standard deviation of each of them (size,)."""
        ends, turns = 3 * (len(self.seen) + (self.tip is not None)), 3 * len(self.frames)
        rest = len(self.lengths or ()) + len(self.strokes or ())
        return np.repeat([self.std, self.angle_std, self.std], [ends, turns, rest])

    def checked(self, arm: Arm, name: str) -> Measured:
        """Return the shape by the name `name`, tensions flat; InputError for what is not of it."""
        flat = arm.flat(self.tensions, f"{name}: tensions")
        for what, places in (("points", self.points), ("frames", self.frames)):
            for i, own in enumerate(places):
                if not 0 <= own.s <= arm.length * (1 + 1e-12):
                    hint = _millimetres(own.s / arm.length)
                    allowed = f"on the arm, 0 to {arm.length:g} m{hint}"
                    raise InputError(f"{name}: {what}[{i}].s", own.s, allowed)
        for i, point in self.seen:
            _check_place(arm, f"{name}: points[{i}]", point.place, point.offset)
        if self.tip is not None:
            _check_place(arm, f"{name}: tip", self.tip, (0.0, 0.0, 0.0))
        for what in ("lengths", "strokes"):
            given = getattr(self, what)
            if given is not None and len(given) != arm.n_tendons:
                raise InputError(f"{name}: {what}", len(given), f"one of each of {arm.n_tendons}")
            if given is not None and max(map(abs, given)) > 3 * arm.length:
                hint = _millimetres(max(map(abs, given)) / arm.length)
                raise InputError(f"{name}: {what}", given, f"lengths of tendons in m{hint}")
        found = copy(self)  # all else was checked when it was made
        object.__setattr__(found, "tensions", tuple(flat.tolist()))
        object.__setattr__(found, "name", name)
        return found


def _point(i: int, given: Any) -> Point:
    where = f"Measured.points[{i}]"
    try:
        s, offset, place = given
    except (TypeError, ValueError):
        raise InputError(where, given, "(s, (o_t, o_n, o_b), (x, y, z)), all in m") from None
    return Point(
        float(finite_array(f"{where}.s", s, ())),
        tuple(finite_array(f"{where}.offset", offset, (3,)).tolist()),
        None if place is None else tuple(finite_array(f"{where}.place", place, (3,)).tolist()),
    )


def _frame(i: int, given: Any) -> MeasuredFrame:
    where = f"Measured.frames[{i}]"
    try:
        s, matrix = given
    except (TypeError, ValueError):
        raise InputError(where, given, "(s, matrix (3, 3))") from None
    R = finite_array(where, matrix, (3, 3))
    if np.abs(R.T @ R - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(R) < 0:
        raise InputError(where, matrix, "a right-handed orthonormal frame, columns t, n, b")
    return MeasuredFrame(float(finite_array(f"{where}.s", s, ())), tuple(map(tuple, R.tolist())))


def _check_place(arm: Arm, where: str, place: Any, offset: Any) -> None:
    """Refuse a place that the arm cannot reach, or one that says that all are in other units."""
    away = float(np.linalg.norm(np.array(place) - arm.base_position))
    reach = arm.length + float(np.linalg.norm(offset))
    if away > _FAR * reach:
        allowed = f"within reach, {_FAR * reach:.3g} m of the base{_millimetres(away / reach)}"
        raise InputError(where, place, allowed)
    if np.linalg.norm(offset) > arm.length:
        hint = _millimetres(float(np.linalg.norm(offset)) / arm.length * 10)
        raise InputError(f"{where}: offset", offset, f"near the midline, in m{hint}")


def check_scale(arm: Arm, shapes: Sequence[Measured]) -> None:
    """Refuse shapes of which all markers are next to the base: they may be in kilometres."""
    ends = [point.s for shape in shapes for _, point in shape.seen]
    far = [float(d) for m in shapes for d in np.linalg.norm(m.places - arm.base_position, axis=1)]
    if far and max(far) < _TINY * min(max(ends), arm.length):
        allowed = f"places in m; the arm is {arm.length:g} m long: are they 1000 times too small?"
        raise InputError("points", f"all within {max(far):.3g} m of the base", allowed)


def _millimetres(ratio: float) -> str:
    """Return a hint where a value over what it could be at most says that it is in mm."""
    return "; is it in mm? Lengths are in m" if 20 < ratio < 3000 else ""
