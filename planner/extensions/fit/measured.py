"""What was measured of one shape of an arm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np

from octoplan.model import Arm, InputError
from octoplan.model.paths import Array
from octoplan.model.support.checks import SUCH, kind, orthonormal
from octoplan.model.support.quantities import Matrix, NotNegative, Positive, Vector
from octoplan.model.support.units import DISTANCE
from octoplan.model.support.value import Rule, value
from octoplan.model.winches import rest_lengths

# Standard deviations [m], [rad] that weigh places and lengths against frames if none is given: only
# their ratio counts then.
_ASSUMED_STD, _ASSUMED_ANGLE_STD = 1e-3, 1e-2
# Markers farther from the base than this, in arm lengths and offsets, cannot be on the arm.
_FAR = 1.5
MIDLINE = (0.0, 0.0, 0.0)


class Point(NamedTuple):
    """A marker: arc length [m], offset in the local frame (t, n, b) [m], place [m] if seen."""

    s: float
    offset: Vector
    place: Vector | None


class MeasuredFrame(NamedTuple):
    """A frame at an arc length [m]: columns t, n, b in the base frame (3, 3), row by row."""

    s: float
    matrix: Annotated[Matrix, Rule(partial(orthonormal, rounding=1e-3))]


class Sensor(NamedTuple):
    """What is looked at on the arm.

    Its name; arc length [m], inf of the tip; what was measured there, a place (3,) [m] or a frame
    (3, 3); offset in the local frame [m]; and the number of the point, -1 of what is none.
    """

    what: str
    s: float
    value: Any
    offset: Vector = MIDLINE
    point: int = -1


SUCH[Point] = "(s, (o_t, o_n, o_b), (x, y, z)), all in m"
SUCH[MeasuredFrame] = "(s, matrix (3, 3))"


@value
class Measured:
    """One measured shape, in SI units and the coordinates in which the arm's base is given.

    Load cells tell tensions, encoders lengths or strokes. Where both are given the arm is settled
    under the tensions, and the lengths are residuals; where only lengths or strokes are, it is
    settled by them. What is known of the arm at rest (its droop) is a shape without tensions.

    Attributes
    ----------
    tensions : (n_tendons,) or by section
        [N]; None where winches hold the tendons by `lengths` or `strokes`.
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
        Standard deviation of places, lengths and strokes [m]. Surplus data scale it, unless
        `absolute_std` of `calibrate` is True; without surplus data it holds as given. If it is not
        given, 1 mm weighs places against the rest, and only surplus data give standard errors.
    angle_std : float
        Standard deviation of frames [rad]; 0.01 in the same way.
    tension_std : float
        Standard deviation of the tensions [N]; 0: they are exact.
    length_std : float
        Standard deviation of lengths and strokes [m], `std` unless given.
    """

    tensions: Any = None
    points: tuple[Point, ...] = ()
    frames: tuple[MeasuredFrame, ...] = ()
    tip: Vector | None = None
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
        """Whether the arm is settled by lengths or strokes."""
        return self.tensions is None

    @property
    def markers(self) -> list[Sensor]:
        """What is looked at whose place is measured: the points that were seen, and the tip."""
        points = [
            Sensor(f"points[{i}]", point.s, point.place, point.offset, i)
            for i, point in enumerate(self.points)
            if point.place is not None
        ]
        return points if self.tip is None else [*points, Sensor("tip", np.inf, self.tip)]

    @property
    def sensors(self) -> list[Sensor]:
        """All that is looked at: markers, then frames."""
        frames = [Sensor(f"frames[{i}]", *each) for i, each in enumerate(self.frames)]
        return [*self.markers, *frames]

    @property
    def places(self) -> Array:
        """The measured places of markers and tip (n, 3) [m]."""
        return np.array([sensor.value for sensor in self.markers], dtype=float).reshape(-1, 3)

    def arc_lengths(self, arm: Arm) -> Array:
        """Return where `places` are along the arm (n,) [m]."""
        return np.array([min(sensor.s, arm.length) for sensor in self.markers])

    @property
    def numbers(self) -> Array:
        """All that was measured (size,): places, frames as 0, lengths, strokes."""
        runs = [np.array(getattr(self, kind)) for kind in self.runs]
        return np.concatenate([self.places.ravel(), np.zeros(3 * len(self.frames)), *runs])

    @property
    def stds(self) -> Array:
        """Standard deviation of each number that is measured (size,)."""
        counts = [3 * len(self.places), 3 * len(self.frames)]
        counts.append(self.numbers.size - sum(counts))
        of_frames = self.angle_std or _ASSUMED_ANGLE_STD
        return np.repeat([self.place_std, of_frames, self.tendon_std], counts)

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
        """Whether the standard deviations of all numbers are given."""
        uses_tendons = self.by_length or bool(self.runs)
        return (
            (self.std is not None or not self.markers)
            and (self.angle_std is not None or not self.frames)
            and (self.length_std is not None or self.std is not None or not uses_tendons)
        )

    @property
    def size(self) -> int:
        """How many numbers residuals are made of: places, rotation vectors, lengths, strokes."""
        return int(self.numbers.size)

    @property
    def runs(self) -> list[str]:
        """Which of lengths and strokes are residuals: those that do not drive the shape."""
        kinds = [] if self.by_length else ["lengths", "strokes"]
        return [kind for kind in kinds if getattr(self, kind) is not None]

    def run_values(self, lengths: Callable[[], Array], rest: Array | float) -> list[Array]:
        """Return the lengths and strokes that are residuals, or their derivatives (n_tendons, ...).

        By those of the tendons' lengths, which are asked for if need be, and of lengths at rest.
        """
        return [lengths() if run == "lengths" else rest - lengths() for run in self.runs]

    def checked(self, arm: Arm, name: str) -> Measured:
        """Return the shape by the name `name`, tensions flat; InputError for what is not of it."""
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
            _check_place(arm, where, np.array(sensor.value), np.array(sensor.offset))
        for what in ("lengths", "strokes"):
            if getattr(self, what) is not None:
                _check_runs(arm, f"{name}: {what}", getattr(self, what))
        if self.strokes is not None:
            # No more of a tendon is taken in than there is of it.
            rest = rest_lengths(arm)
            most = int(np.argmax(np.array(self.strokes) - rest))
            if self.strokes[most] > rest[most]:
                allowed = f"less than the tendon's length at rest, {rest[most]:.3g} m; is it in mm?"
                where = f"{name}: strokes, {arm.tendon_name(most)}"
                raise InputError(where, self.strokes[most], allowed)
        return replace(self, tensions=flat, name=name)


def checked_shapes(arm: Arm, measured: Iterable[Measured]) -> tuple[Measured, ...]:
    """Return shapes of an arm, each with a name; InputError for what is not of it, and for none."""
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
    stiffness = arm.material.E * np.pi * arm.base_radius**2
    if most <= stiffness:
        return ""
    return (
        f"Tensions of up to {most:g} N are {most / stiffness:.3g} times the arm's E A at its base, "
        f"{stiffness:.3g} N: are they in mN?"
    )


def _check_place(arm: Arm, where: str, place: Array, offset: Array) -> None:
    """Refuse a place that the arm cannot reach, or one that says that all are in other units."""
    away, aside = float(np.linalg.norm(place - arm.base_position)), float(np.linalg.norm(offset))
    reach = arm.length + aside
    if away > _FAR * reach:
        axis = "xyz"[int(np.argmax(np.abs(place - arm.base_position)))]
        allowed = f"within reach, {_FAR * reach:.3g} m of the base{_in_mm(away / reach)}"
        raise InputError(f"{where}, {axis}", tuple(place.tolist()), allowed)
    if aside > arm.length:
        allowed = f"near the midline, in m{_in_mm(10 * aside / arm.length)}"
        raise InputError(f"{where}: offset", tuple(offset.tolist()), allowed)


def _check_runs(arm: Arm, where: str, lengths: Sequence[float]) -> None:
    """Refuse lengths or strokes of another number of tendons, or in other units."""
    if len(lengths) != arm.n_tendons:
        allowed = f"one of each of {arm.n_tendons} tendons"
        raise InputError(where, f"{len(lengths)} numbers", allowed)
    most = int(np.argmax(np.abs(lengths)))
    if abs(lengths[most]) > 3 * arm.length:
        allowed = f"lengths of tendons in m{_in_mm(abs(lengths[most]) / arm.length)}"
        raise InputError(f"{where}, {arm.tendon_name(most)}", lengths[most], allowed)


def _check_scale(arm: Arm, shapes: Sequence[Measured]) -> None:
    """Refuse shapes of which all markers are next to the base: they may be in kilometres."""
    ends = np.concatenate([shape.arc_lengths(arm) for shape in shapes])
    away = np.vstack([shape.places for shape in shapes]) - arm.base_position
    far = float(np.linalg.norm(away, axis=1).max(initial=0.0))
    if far < DISTANCE.least * ends.max(initial=0.0):
        allowed = f"places in m; the arm is {arm.length:g} m long: are they 1000 times too small?"
        raise InputError("points", f"all within {far:.3g} m of the base", allowed)


def _in_mm(ratio: float) -> str:
    """Return a hint where a value over what it could be at most says that it is in mm."""
    return "; is it in mm? Lengths are in m" if 20 < ratio < 3000 else ""
