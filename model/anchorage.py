"""Where tendons end, and the way that they take there."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from model.errors import InputError
from model.paths import Path
from model.quantities import Angle, AnglePaths, Length, LengthPaths
from model.units import warn_of_angles
from model.value import value

QUARTERS = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


@value
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
        warn_of_angles("Anchorage.angles", self.angles, usual=2)
        for name, own in (("offset", self.offset), ("turn", self.turn)):
            if isinstance(own, tuple) and len(own) != len(self.angles):
                allowed = f"one for each of {len(self.angles)} tendons"
                raise InputError(f"Anchorage.{name}", f"{len(own)} paths", allowed)

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
