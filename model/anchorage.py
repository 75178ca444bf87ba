"""Where tendons end, and the way that they take there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from model.checks import finite_array, kind, positive
from model.errors import InputError
from model.paths import Path
from model.quantities import Angle, AnglePaths, Length, LengthPaths
from model.units import warn_of_angles

QUARTERS = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


@dataclass(frozen=True)
class Anchorage:
    """A cross-section where tendons end, and the way that these take to it from the base.

    Attributes
    ----------
    at : float
        Arc length l_i of the section from the base [m].
    offset : Path, or a tuple with one for each tendon
        Distance y_i(s) of the tendons from the midline on [0, l_i] [m]; eq. (5) is `Linear(a, b)`.
    angles : tuple of float
        One tendon for each: the angle phi of its side d = cos(phi) n + sin(phi) b [rad].
        The paper's four tendons j = 1..4 (n, b, -n, -b) unless given.
    turn : Path, or a tuple with one for each tendon
        What is added to these angles along the arm [rad]; 0 unless given. Tendons that turn
        twist the arm, which scenes with loads can have.
    """

    at: Length
    offset: LengthPaths
    angles: Annotated[tuple[Angle, ...], Meta(min_length=1)] = QUARTERS
    turn: AnglePaths | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", positive("Anchorage.at", self.at))
        angles = finite_array("Anchorage.angles", self.angles, (None,))
        if angles.size == 0:
            raise InputError("Anchorage.angles", self.angles, "at least one tendon")
        warn_of_angles("Anchorage.angles", angles.tolist(), usual=2)
        object.__setattr__(self, "angles", tuple(angles.tolist()))
        object.__setattr__(self, "offset", self._checked("offset", self.offset))
        if self.turn is not None:
            object.__setattr__(self, "turn", self._checked("turn", self.turn))

    def _checked(self, name: str, given: Any) -> Path | tuple[Path, ...]:
        """Return a path, or as many as there are tendons."""
        field, allowed = f"Anchorage.{name}", "a Linear or a Sampled path"
        if not isinstance(given, Sequence):
            kind(field, given, Path, f"{allowed}, or a tuple with one for each tendon")
            path: Path = given
            return path
        for j, own in enumerate(given):
            kind(f"{field}[{j}]", own, Path, allowed)
        if len(given) != len(self.angles):
            raise InputError(field, f"{len(given)} paths", f"one for each of {len(self.angles)}")
        return tuple(given)

    @property
    def offsets(self) -> tuple[Path, ...]:
        """The offset of each tendon."""
        return self._each(self.offset)

    @property
    def turns(self) -> tuple[Path | None, ...]:
        """The turn of each tendon, None where there is none."""
        return (None,) * len(self.angles) if self.turn is None else self._each(self.turn)

    @property
    def paths(self) -> tuple[Path, ...]:
        """All paths that were given, each once."""
        given = (self.offset, self.turn)
        rows = [own if isinstance(own, tuple) else (own,) for own in given]
        return tuple(path for row in rows for path in row if path is not None)

    def _each(self, given: Path | tuple[Path, ...]) -> tuple[Path, ...]:
        return given if isinstance(given, tuple) else (given,) * len(self.angles)
