"""Measurements of one shape of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np

from octoplan.model import Arm, InputError
from octoplan.model.extensions.lengths.winches import split_missing
from octoplan.model.paths import Array, Mask
from octoplan.model.support.checks import SUCH, is_several, kind, orthonormal
from octoplan.model.support.errors import Described
from octoplan.model.support.units import DISTANCE
from octoplan.model.support.value import Matrix, NotNegative, Positive, Rule, Vector, value
from octoplan.model.tendons import rest_lengths

# Standard deviations of places and lengths [m], and of frames [rad], if none are given. Only their
# ratio matters then.
_ASSUMED_STD = 1e-3
_ASSUMED_ANGLE_STD = 1e-2
# Distance from the base, over arm length plus offset, beyond which a marker cannot be on the arm.
_FAR = 1.5
# Offset of a point on the midline.
MIDLINE = (0.0, 0.0, 0.0)


def _nan_as_none(_: str, number: Any) -> Any:
    """Return None for NaN, otherwise the given value."""
    return None if isinstance(number, float | np.floating) and np.isnan(number) else number


# A number that may be missing: None or NaN.
OptionalNumber = Annotated[float | None, Rule(_nan_as_none, is_first=True)]


# A measured place in the base frame [m]; None for a coordinate that was not measured.
Coordinates = tuple[OptionalNumber, OptionalNumber, OptionalNumber]


def _measures_something(name: str, place: Coordinates) -> Coordinates:
    """Return a place with a measured coordinate, or raise InputError."""
    if place == (None, None, None):
        allowed = "a place with at least one coordinate; None in place of an unseen marker"
        raise InputError(name, place, allowed)
    return place


Place = Annotated[Coordinates, Rule(_measures_something)]


class Point(NamedTuple):
    """A marker: arc length [m], offset in the local frame (t, n, b) [m], measured place [m]."""

    s: float
    offset: Vector
    place: Place | None


class MeasuredFrame(NamedTuple):
    """A frame at an arc length [m]: columns t, n, b in the base frame (3, 3), row by row."""

    s: float
    matrix: Annotated[Matrix, Rule(partial(orthonormal, rounding=1e-3))]


class Sensor(NamedTuple):
    """A sensor on the arm.

    Attributes
    ----------
    what : str
        Name.
    s : float
        Arc length [m]; inf for the tip.
    value : (3,) or (3, 3)
        Measured place [m], with None for missing coordinates, or frame.
    offset : (3,)
        Offset in the local frame [m].
    point : int
        Index of the point, or -1 if the sensor is not a point.
    """

    what: str
    s: float
    value: Any
    offset: Vector = MIDLINE
    point: int = -1


SUCH[float | None] = "a number, None or NaN"
SUCH[Coordinates] = "(x, y, z) in m, None or NaN for a coordinate that was not measured"
SUCH[Point] = "(s, (o_t, o_n, o_b), (x, y, z)), all in m"
SUCH[MeasuredFrame] = "(s, matrix (3, 3))"


@value
class Measured:
    """One measured shape, in SI units and in the coordinates of the arm's base.

    Load cells measure tensions, encoders measure lengths or strokes. A tendon with a tension is
    settled under the tension, and its length or stroke is a residual. A tendon without tension is
    held by a winch at its length or stroke. Represent measurements of the arm at rest (its droop)
    by a shape with zero tensions.

    Attributes
    ----------
    tensions : (n_tendons,) or by section
        [N]; None or NaN for tendons that winches hold by `lengths` or `strokes`, None if winches
        hold all tendons.
    points : sequence of (s, offset, place)
        Markers: arc length [m], offset from the midline in the local frame (t, n, b) [m], and
        measured place (3,) [m], or None if the marker was not seen. A coordinate that was not
        measured is None or NaN, such as the depth of a side camera.
    frames : sequence of (s, matrix)
        Measured frames (3, 3), columns t, n, b.
    tip : (3,)
        Measured place of the tip [m]; None or NaN for a coordinate that was not measured.
    lengths : (n_tendons,)
        Measured lengths of the tendons from base to anchorage [m]; None or NaN for tendons without
        encoder. Such a tendon is slack if no tension is given either.
    strokes : (n_tendons,)
        Lengths of tendon taken in since the straight arm at rest [m]; None or NaN as in `lengths`.
        Unknowns "winches.zero_mm[j]" are added to the strokes.
    session : str
        Label of the session; unknowns can be common to the shapes of a session.
    name : str
        Name of the shape in reports.
    std : float
        Standard deviation of places, lengths and strokes [m]. Surplus data scale it, unless
        `absolute_std` of `calibrate` is True; without surplus data it applies as given. If None,
        places have a relative weight of 1 mm, and standard errors require surplus data.
    angle_std : float
        Standard deviation of frames [rad]. If None, frames have a relative weight of 0.01 rad.
    tension_std : float
        Standard deviation of the tensions [N]; 0 for exact tensions.
    length_std : float
        Standard deviation of lengths and strokes [m]; `std` unless given.
    """

    tensions: Any = None
    points: tuple[Point, ...] = ()
    frames: tuple[MeasuredFrame, ...] = ()
    tip: Place | None = None
    lengths: tuple[OptionalNumber, ...] | None = None
    strokes: tuple[OptionalNumber, ...] | None = None
    session: str = ""
    name: str = ""
    std: Positive | None = None
    angle_std: Positive | None = None
    tension_std: NotNegative = 0.0
    length_std: Positive | None = None

    def __post_init__(self) -> None:
        name = f"Measured {self.name}".rstrip()
        if self.tensions is None and (self.lengths is None) == (self.strokes is None):
            given = Described("a shape without tensions, lengths and strokes")
            if self.lengths is not None:
                given = Described("a shape with lengths and strokes")
            allowed = "a shape with tensions, or else with lengths or strokes"
            raise InputError(name, given, allowed)
        if self.tensions is None and not self.by_length:
            kind = "strokes" if self.lengths is None else "lengths"
            raise InputError(f"{name}: {kind}", self.winch_readings, "a number of some tendon")
        held = [j for j, is_held in enumerate(self.held) if is_held]
        if held and self.lengths is not None and self.strokes is not None:
            allowed = "omitted, or else lengths, for tendons without tension"
            raise InputError(f"{name}: strokes", self.strokes, allowed)
        for j in held:
            if self.winch_readings[j : j + 1] in ((), (None,)):
                allowed = "a tension, or a length or stroke of this tendon; 0 if it is slack"
                raise InputError(f"{name}: tensions[{j}]", None, allowed)
        if not self.size:
            allowed = "points, frames or a tip; with tensions, lengths or strokes suffice"
            raise InputError(name, Described("no measurement"), allowed)

    @property
    def by_length(self) -> bool:
        """Whether winches hold some tendons by their lengths or strokes."""
        return any(self.held)

    @property
    def held(self) -> tuple[bool, ...]:
        """Whether a winch holds each tendon by its length or stroke (n_tendons,)."""
        if self.tensions is None:
            return tuple(reading is not None for reading in self.winch_readings)
        return tuple(T is None for T in _flattened(self.tensions))

    @property
    def winch_readings(self) -> tuple[float | None, ...]:
        """Lengths or strokes of the tendons that winches hold [m]; None for other tendons."""
        return (self.strokes if self.lengths is None else self.lengths) or ()

    @property
    def markers(self) -> list[Sensor]:
        """The sensors that measure a place: the points that were seen, and the tip."""
        points = [
            Sensor(f"points[{i}]", point.s, point.place, point.offset, i)
            for i, point in enumerate(self.points)
            if point.place is not None
        ]
        return points if self.tip is None else [*points, Sensor("tip", np.inf, self.tip)]

    @property
    def sensors(self) -> list[Sensor]:
        """All sensors: markers, then frames."""
        frames = [Sensor(f"frames[{i}]", *each) for i, each in enumerate(self.frames)]
        return [*self.markers, *frames]

    @property
    def places(self) -> Array:
        """The measured places of markers and tip (n, 3) [m]; NaN for missing coordinates."""
        return np.array([sensor.value for sensor in self.markers], dtype=float).reshape(-1, 3)

    @property
    def is_measured(self) -> Mask:
        """Whether each component of each sensor was measured (n, 3); True for frames."""
        frames = np.ones((len(self.frames), 3), dtype=bool)
        return np.vstack([~np.isnan(self.places), frames])

    def arc_lengths(self, arm: Arm) -> Array:
        """Return the arc lengths of `places` (n,) [m]."""
        return np.array([min(sensor.s, arm.length) for sensor in self.markers])

    @property
    def data(self) -> Array:
        """All measurements (size,): measured coordinates, frames as 0, lengths, strokes."""
        tendons = [getattr(self, kind)[j] for kind, j in self.tendon_residuals]
        places = self.places
        coordinates = places[~np.isnan(places)]
        return np.concatenate([coordinates, np.zeros(3 * len(self.frames)), tendons])

    @property
    def stds(self) -> Array:
        """Standard deviation of each measurement (size,)."""
        places = self.places
        counts = [int(np.count_nonzero(~np.isnan(places))), 3 * len(self.frames)]
        counts.append(self.data.size - sum(counts))
        frame_std = self.angle_std or _ASSUMED_ANGLE_STD
        return np.repeat([self.place_std, frame_std, self.tendon_std], counts)

    @property
    def place_std(self) -> float:
        """Standard deviation of places [m], given or assumed."""
        return self.std or _ASSUMED_STD

    @property
    def tendon_std(self) -> float:
        """Standard deviation of lengths and strokes [m], given or assumed."""
        return self.length_std or self.place_std

    @property
    def has_stds(self) -> bool:
        """Whether the standard deviations of all measurements are given."""
        uses_tendons = bool(self.by_length or self.tendon_residuals)
        return (
            (self.std is not None or not self.markers)
            and (self.angle_std is not None or not self.frames)
            and (self.length_std is not None or self.std is not None or not uses_tendons)
        )

    @property
    def size(self) -> int:
        """Number of residuals: measured coordinates, rotation vectors, lengths, strokes."""
        return int(self.data.size)

    @property
    def tendon_residuals(self) -> list[tuple[str, int]]:
        """The residuals of tendons: "lengths" or "strokes", and the index of the tendon."""
        return [
            (kind, j)
            for kind in ("lengths", "strokes")
            for j, reading in enumerate(getattr(self, kind) or ())
            if reading is not None and not any(self.held[j : j + 1])
        ]

    def reordered(self, order: Sequence[int]) -> Measured:
        """Return the shape with the tendons in another order: tendon j is measured as order[j].

        The tensions are flat, as `checked` returns them.
        """
        values: dict[str, Any] = {
            kind: tuple(getattr(self, kind)[j] for j in order)
            for kind in ("tensions", "lengths", "strokes")
            if getattr(self, kind) is not None
        }
        return replace(self, **values)

    def checked(self, arm: Arm, name: str) -> Measured:
        """Return the shape with a name and flat tensions, or raise InputError."""
        for what in ("points", "frames"):
            for i, row in enumerate(getattr(self, what)):
                if not 0 <= row.s <= arm.length * (1 + 1e-12):
                    allowed = f"on the arm, 0 to {arm.length:g} m{_in_mm(row.s / arm.length)}"
                    raise InputError(f"{name}: {what}[{i}].s", row.s, allowed)
        for sensor in self.markers:
            where = f"{name}: {sensor.what}"
            _check_place(arm, where, np.array(sensor.value, float), np.array(sensor.offset))
        return replace(self, name=name).with_flat_tensions(arm)

    def with_flat_tensions(self, arm: Arm) -> Measured:
        """Return the shape with flat tensions; raise InputError for unsuitable drives."""
        name = self.name
        flat = None
        if self.tensions is not None:
            T, is_given = split_missing(arm, self.tensions, f"{name}: tensions")
            pairs = zip(T.tolist(), is_given, strict=True)
            flat = tuple(pull if given else None for pull, given in pairs)
        for what in ("lengths", "strokes"):
            if getattr(self, what) is not None:
                _check_lengths(arm, f"{name}: {what}", getattr(self, what))
        if self.strokes is not None:
            # A stroke cannot exceed the length of the tendon.
            rest = rest_lengths(arm)
            strokes = np.array(self.strokes, dtype=float)
            most = int(np.nanargmax(strokes - rest))
            if strokes[most] > rest[most]:
                allowed = f"less than the tendon's length at rest, {rest[most]:.3g} m; is it in mm?"
                where = f"{name}: strokes, {arm.tendon_name(most)}"
                raise InputError(where, self.strokes[most], allowed)
        return replace(self, tensions=flat)


def checked_shapes(arm: Arm, measured: Iterable[Measured]) -> tuple[Measured, ...]:
    """Return shapes of an arm, each with a name; InputError for unsuitable shapes or no shapes."""
    shapes = tuple(kind("measured", measured, Iterable, "a sequence of Measured"))
    if not shapes:
        raise InputError("measured", shapes, "at least one shape")
    for i, shape in enumerate(shapes):
        kind(f"measured[{i}]", shape, Measured, "a Measured")
    names = [shape.name or f"measured[{i}]" for i, shape in enumerate(shapes)]
    for name in names:
        if names.count(name) > 1:
            raise InputError("Measured.name", name, "each name once")
    _check_scale(arm, shapes)
    return tuple(shape.checked(arm, name) for shape, name in zip(shapes, names, strict=True))


def crushing_remark(arm: Arm, measured: Iterable[Measured]) -> str:
    """Return the remark that tensions exceed E A of the arm's base; "" if they do not."""
    most = max((T or 0.0 for shape in measured for T in shape.tensions or ()), default=0.0)
    stiffness = float(arm.section_stiffness(np.zeros(1))[0, 0, 0])
    if most <= stiffness:
        return ""
    return (
        f"Tensions of up to {most:g} N are {most / stiffness:.3g} times the arm's E A at its base, "
        f"{stiffness:.3g} N: are they in mN?"
    )


def _check_place(arm: Arm, where: str, place: Array, offset: Array) -> None:
    """Raise InputError for a place that the arm cannot reach, which suggests other units."""
    from_base = np.nan_to_num(place - arm.base_position)
    away = float(np.linalg.norm(from_base))
    aside = float(np.linalg.norm(offset))
    reach = arm.length + aside
    if away > _FAR * reach:
        axis = "xyz"[int(np.argmax(np.abs(from_base)))]
        allowed = f"within reach, {_FAR * reach:.3g} m of the base{_in_mm(away / reach)}"
        given = tuple(None if np.isnan(x) else x for x in place.tolist())
        raise InputError(f"{where}, {axis}", given, allowed)
    if aside > arm.length:
        allowed = f"near the midline, in m{_in_mm(10 * aside / arm.length)}"
        raise InputError(f"{where}: offset", tuple(offset.tolist()), allowed)


def _flattened(values: Any) -> tuple[Any, ...]:
    """Return the numbers of nested sequences, None for NaN; others are refused by `checked`."""
    if not is_several(values):
        return (_nan_as_none("", values),)
    return tuple(number for part in values for number in _flattened(part))


def _check_lengths(arm: Arm, where: str, lengths: Sequence[float | None]) -> None:
    """Raise InputError for lengths or strokes of wrong number or implausible size."""
    if len(lengths) != arm.n_tendons:
        allowed = f"{arm.n_tendons} numbers, one for each tendon"
        raise InputError(where, Described(f"{len(lengths)} numbers"), allowed)
    sizes = np.abs(np.array(lengths, dtype=float))
    if np.isnan(sizes).all():
        raise InputError(where, lengths, "a number of some tendon")
    most = int(np.nanargmax(sizes))
    if sizes[most] > 3 * arm.length:
        allowed = f"lengths of tendons in m{_in_mm(sizes[most] / arm.length)}"
        raise InputError(f"{where}, {arm.tendon_name(most)}", lengths[most], allowed)


def _check_scale(arm: Arm, shapes: Sequence[Measured]) -> None:
    """Raise InputError if all markers are close to the base, which suggests other units.

    Missing coordinates may be the large ones: only complete places count.
    """
    ends = np.concatenate([shape.arc_lengths(arm) for shape in shapes])
    away = np.linalg.norm(np.vstack([shape.places for shape in shapes]) - arm.base_position, axis=1)
    is_complete = ~np.isnan(away)
    ends = ends[is_complete]
    far = float(away[is_complete].max(initial=0.0))
    if far < DISTANCE.least * ends.max(initial=0.0):
        allowed = f"places in m; the arm is {arm.length:g} m long: are they 1000 times too small?"
        raise InputError("points", Described(f"all within {far:.3g} m of the base"), allowed)


def _in_mm(ratio: float) -> str:
    """Return a hint at millimetres if a value over its plausible maximum suggests these."""
    return "; is it in mm? Lengths are in m" if 20 < ratio < 3000 else ""
