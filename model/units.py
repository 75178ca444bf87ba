"""Warnings of numbers that are likely given in another unit: millimetres, degrees, kilopascals.

Numbers that are only unusual are allowed; what they are taken for, and what was likely meant, is
told once at the line that gave them. `warnings.simplefilter("ignore", UnitWarning)` is silence.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import FrameType

_OURS = frozenset({"model", "planner", "octoplan", "octoplan_packages"})


# What stands between a script and what it calls.
_BETWEEN = frozenset({"model.progress", "model.settle", "model.units"})


def called_by_a_script() -> bool:
    """Return whether a public call is a script's, and no part of another call of ours."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "") in _BETWEEN:
        frame = frame.f_back
    return frame is None or frame.f_globals.get("__name__", "").split(".")[0] not in _OURS


def warn(message: str, category: type[Warning]) -> None:
    """Warn as of the nearest line that is not this project's."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


_SENTENCES_IN_MM = ContextVar("sentences tell lengths in mm", default=False)


@contextmanager
def millimetres() -> Iterator[None]:
    """Let sentences inside the block tell lengths in mm, as the files do that they are about."""
    token = _SENTENCES_IN_MM.set(True)
    try:
        yield
    finally:
        _SENTENCES_IN_MM.reset(token)


def length_text(metres: float) -> str:
    """Return a length as a sentence tells it: in m, or as `millimetres` wants it."""
    return f"{1e3 * metres:.6g} mm" if _SENTENCES_IN_MM.get() else f"{metres:.6g} m"


class UnitWarning(UserWarning):
    """A number that was likely given in another unit."""


@dataclass(frozen=True)
class Usual:
    """What numbers of a kind usually are, and what to tell of others.

    Sentences may hold `{field}`; the number `{x}`, a thousandth, a thousand and a million times it,
    `{m}`, `{k}` and `{M}`; of an angle its `{turns}`, and `{rad}`, what it is in degrees.

    Attributes
    ----------
    least, most : float
        Of the size of the number.
    small, large : str
        The sentences about what is below and above.
    """

    least: float
    most: float
    small: str
    large: str


LENGTH = Usual(
    2e-3,
    30.0,
    "{field} is {x:g} m, {k:g} mm; if {k:g} m were meant, give {k:g} (m), or {M:g} in a key in mm",
    "{field} is {x:g} m; if millimetres were meant, give {m:g} (m)",
)
WIDTH = Usual(
    LENGTH.least,
    LENGTH.most,
    "{field} is {k:.4g} mm wide; if that is in metres, unit='m' was meant",
    "{field} is {x:.4g} m wide; if that is in millimetres, unit='mm' was meant",
)
MODULUS = Usual(
    1e3,
    2e12,
    "{field} is {x:g} Pa, softer than any elastomer; if kilopascals were meant, give {k:g} (Pa)",
    "{field} is {x:g} Pa, harder than diamond; if that was in pascals already, give {m:g} Pa",
)
DENSITY = Usual(
    25.0,  # foams are heavier
    math.inf,
    "{field} is {x:g} kg/m3, lighter than any elastomer; if g/cm3 were meant, give {k:g} (kg/m3)",
    "",
)
# Directions, and angles of tendons around the arm.
ANGLE, ANGLE_AROUND = (
    Usual(
        0.0,
        2 * math.pi * turns * (1 + 1e-9),
        "",
        "{field} is {x:g} rad, {turns:.3g} turns; if degrees were meant, give {rad:.6g} (rad)",
    )
    for turns in (1, 2)
)
# Over the arm's length: distances of targets from the base, lengths of tendons, and strokes of
# winches, of which shorter ones move no tip that anybody sees.
_IN_MM, _IN_M = "if metres were meant in a key in mm", "if millimetres were meant for metres"
DISTANCE = Usual(
    3e-3,
    50.0,
    f"{{field}} is {{x:.2g}} arm lengths from the base; {_IN_MM}, it is 1000 times too near",
    f"{{field}} is {{x:.3g}} arm lengths from the base; {_IN_M}, it is 1000 times too far",
)
TENDONS = Usual(
    3e-3,
    50.0,
    f"{{field}} are all about {{x:.2g}} arm lengths; {_IN_MM}, they are 1000 times too short",
    f"{{field}} are all about {{x:.3g}} arm lengths; {_IN_M}, they are 1000 times too long",
)
STROKE = Usual(
    3e-4,
    50.0,
    f"{{field}} is {{x:.2g}} arm lengths or less; {_IN_MM}, it is 1000 times too little",
    f"{{field}} is {{x:.3g}} arm lengths; {_IN_M}, it is 1000 times too much",
)


def warn_unusual(field: str, numbers: Iterable[float], usual: Usual) -> None:
    """Warn of the first of numbers that is too large, or of the largest if all are too small."""
    finite = [x for x in numbers if math.isfinite(x)]
    large = next((x for x in finite if abs(x) > usual.most), None)
    x = large if large is not None else max(finite, key=abs, default=0.0)
    if large is not None or 0 < abs(x) < usual.least:
        sentence = usual.small if large is None else usual.large
        scaled = {"x": x, "m": x / 1e3, "k": 1e3 * x, "M": 1e6 * x}
        angle = {"turns": abs(x) / (2 * math.pi), "rad": math.radians(x)}
        warn(sentence.format(field=field, **scaled, **angle), UnitWarning)


def likely_degrees(radians: float) -> str:
    """Return what to give for an angle that is not allowed, if it is likely in degrees."""
    if abs(radians) <= 2 * math.pi or abs(radians) > 360:
        return ""
    return f"; {radians:g} degrees are {math.radians(radians):.6g}"
