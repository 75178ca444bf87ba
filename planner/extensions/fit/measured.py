"""Measurements of one shape of an arm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np

from octoplan.model import Arm, InputError
from octoplan.model.paths import Array, Mask
from octoplan.model.support.checks import SUCH, kind, orthonormal
from octoplan.model.support.quantities import Matrix, NotNegative, Positive, Vector
from octoplan.model.support.units import DISTANCE
from octoplan.model.support.value import Rule, value
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


SUCH[Coordinates] = "(x, y, z) in m, None or NaN for a coordinate that was not measured"
SUCH[Point] = "(s, (o_t, o_n, o_b), (x, y, z)), all in m"
SUCH[MeasuredFrame] = "(s, matrix (3, 3))"


@value
class Measured:
    """One measured shape, in SI units and in the coordinates of the arm's base.

    Load cells measure tensions, encoders measure lengths or strokes. If tensions are given, the arm
    is settled under the tensions, and lengths or strokes are residuals. If only lengths or strokes
    are given, the arm is settled with these lengths. Represent measurements of the arm at rest (its
    droop) by a shape with zero tensions.

    Attributes
    ----------
    tensions : (n_tendons,) or by section
        [N]; None if winches hold the tendons by `lengths` or `strokes`.
    points : sequence of (s, offset, place)
        Markers: arc length [m], offset from the midline in the local frame (t, n, b) [m], and
        measured place (3,) [m], or None if the marker was not seen. A coordinate that was not
        measured is None or NaN, such as the depth of a side camera.
    frames : sequence of (s, matrix)
        Measured frames (3, 3), columns t, n, b.
    tip : (3,)
        Measured place of the tip [m]; None or NaN for a coordinate that was not measured.
    lengths : (n_tendons,)
        Measured lengths of the tendons from base to anchorage [m].
    strokes : (n_tendons,)
        Lengths of tendon taken in since the straight arm at rest [m].
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
    lengths: tuple[float, ...] | None = None
    strokes: tuple[float, ...] | None = None
    session: str = ""
    name: str = ""
    std: Positive | None = None
    angle_std: Positive | None = None
    tension_std: NotNegative = 0.0
    length_std: Positive | None = None

    def __post_init__(self) -> None:
        if self.tensions is None and (self.lengths is None) == (self.strokes is None):
            allowed = "tensions, or else lengths or strokes (one of both), that the arm settles by"
            raise InputError(f"Measured {self.name}".rstrip(), None, allowed)
        if not self.size:
            allowed = "points, frames, a tip; with tensions also lengths or strokes"
            raise InputError(f"Measured {self.name}".rstrip(), "nothing", allowed)

    @property
    def by_length(self) -> bool:
        """Whether lengths or strokes, not tensions, drive the shape."""
        return self.tensions is None

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
        tendons = [np.array(getattr(self, kind)) for kind in self.tendon_residuals]
        places = self.places
        coordinates = places[~np.isnan(places)]
        return np.concatenate([coordinates, np.zeros(3 * len(self.frames)), *tendons])

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
        uses_tendons = self.by_length or bool(self.tendon_residuals)
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
    def tendon_residuals(self) -> list[str]:
        """Names of the residuals among "lengths" and "strokes"; none if these drive the shape."""
        kinds = [] if self.by_length else ["lengths", "strokes"]
        return [kind for kind in kinds if getattr(self, kind) is not None]

    def tendon_values(self, lengths: Callable[[], Array], rest: Array | float) -> list[Array]:
        """Return the predictions of `tendon_residuals`, or their derivatives (n_tendons, ...).

        The arguments are the tendon lengths, evaluated on demand, and the lengths at rest, or the
        derivatives of both.
        """
        return [
            lengths() if kind == "lengths" else rest - lengths() for kind in self.tendon_residuals
        ]

    def checked(self, arm: Arm, name: str) -> Measured:
        """Return the shape with a name and flat tensions, or raise InputError."""
        flat = None
        if not self.by_length:
            flat = tuple(arm.flat(self.tensions, f"{name}: tensions").tolist())
        for what in ("points", "frames"):
            for i, row in enumerate(getattr(self, what)):
                if not 0 <= row.s <= arm.length * (1 + 1e-12):
                    allowed = f"on the arm, 0 to {arm.length:g} m{_in_mm(row.s / arm.length)}"
                    raise InputError(f"{name}: {what}[{i}].s", row.s, allowed)
        for sensor in self.markers:
            where = f"{name}: {sensor.what}"
            _check_place(arm, where, np.array(sensor.value, float), np.array(sensor.offset))
        for what in ("lengths", "strokes"):
            if getattr(self, what) is not None:
                _check_lengths(arm, f"{name}: {what}", getattr(self, what))
        if self.strokes is not None:
            # A stroke cannot exceed the length of the tendon.
            rest = rest_lengths(arm)
            most = int(np.argmax(np.array(self.strokes) - rest))
            if self.strokes[most] > rest[most]:
                allowed = f"less than the tendon's length at rest, {rest[most]:.3g} m; is it in mm?"
                where = f"{name}: strokes, {arm.tendon_name(most)}"
                raise InputError(where, self.strokes[most], allowed)
        return replace(self, tensions=flat, name=name)


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
    most = max((max(shape.tensions or (0.0,)) for shape in measured), default=0.0)
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


def _check_lengths(arm: Arm, where: str, lengths: Sequence[float]) -> None:
    """Raise InputError for lengths or strokes of wrong number or implausible size."""
    if len(lengths) != arm.n_tendons:
        allowed = f"one of each of {arm.n_tendons} tendons"
        raise InputError(where, f"{len(lengths)} numbers", allowed)
    most = int(np.argmax(np.abs(lengths)))
    if abs(lengths[most]) > 3 * arm.length:
        allowed = f"lengths of tendons in m{_in_mm(abs(lengths[most]) / arm.length)}"
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
        raise InputError("points", f"all within {far:.3g} m of the base", allowed)


def _in_mm(ratio: float) -> str:
    """Return a hint at millimetres if a value over its plausible maximum suggests these."""
    return "; is it in mm? Lengths are in m" if 20 < ratio < 3000 else ""
