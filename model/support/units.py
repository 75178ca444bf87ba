"""Warnings of numbers that are likely given in another unit: millimetres, degrees, kilopascals.

Unusual numbers are allowed. The warning names the field and the likely mistake, the same text for
all numbers, so that Python shows it once for each line of a script; its `details` have the number
and the one likely meant. `warnings.simplefilter("ignore", UnitWarning)` silences it.
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

from octoplan.model.support.errors import DetailedWarning

_OURS = "octoplan"


# What stands between a script and what it calls.
_BETWEEN = frozenset(
    {"octoplan.model.support.progress", "octoplan.model.settle", "octoplan.model.support.units"}
)


def called_by_a_script() -> bool:
    """Return whether a public call is a script's, and no part of another call of ours."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "") in _BETWEEN:
        frame = frame.f_back
    return frame is None or frame.f_globals.get("__name__", "").split(".")[0] != _OURS


def warn(text: str, category: type[Warning], details: str = "") -> None:
    """Warn as of the nearest line that is not this project's; `details` are a DetailedWarning's."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == _OURS:
        frame, level = frame.f_back, level + 1
    detailed = issubclass(category, DetailedWarning)
    message = category(text, details) if detailed else category(text)
    warnings.warn(message, stacklevel=level)


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


class UnitWarning(DetailedWarning):
    """A number that was likely given in another unit."""


@dataclass(frozen=True)
class Usual:
    """The usual size of numbers of a kind, and the warnings about others.

    Details may hold `{field}`; the number `{x}`, a thousandth, a thousand and a million times it,
    `{m}`, `{k}` and `{M}`; of an angle its `{turns}`, and `{rad}`, what it is in degrees.

    Attributes
    ----------
    least, most : float
        Bounds of the size of usual numbers.
    small, large : (str, str)
        The constant end of the text about a number below and above, and the details.
    """

    least: float
    most: float
    small: tuple[str, str]
    large: tuple[str, str]


_NONE = "", ""
_IN_MM, _IN_M = "if metres were meant in a key in mm", "if millimetres were meant for metres"
_SMALL, _LARGE = (
    f"is very small; {_IN_MM}, multiply by 1000",
    f"is very large; {_IN_M}, divide by 1000",
)
LENGTH = Usual(
    2e-3,
    30.0,
    (
        _SMALL,
        "{field} is {x:g} m, {k:g} mm; if {k:g} m were meant, give {k:g} (m), or {M:g} in a key "
        "in mm",
    ),
    (_LARGE, "{field} is {x:g} m; if millimetres were meant, give {m:g} (m)"),
)
WIDTH = Usual(
    LENGTH.least,
    LENGTH.most,
    (
        "is very small; if it is in metres, unit='m' was meant",
        "{field} is {k:.4g} mm wide; if that is in metres, unit='m' was meant",
    ),
    (
        "is very wide; if it is in millimetres, unit='mm' was meant",
        "{field} is {x:.4g} m wide; if that is in millimetres, unit='mm' was meant",
    ),
)
MODULUS = Usual(
    1e3,
    2e12,
    (
        "is softer than any elastomer; if kilopascals were meant, multiply by 1000",
        "{field} is {x:g} Pa, softer than any elastomer; if kilopascals were meant, give {k:g} "
        "(Pa)",
    ),
    (
        "is harder than diamond; if that was in pascals already, divide by 1000",
        "{field} is {x:g} Pa, harder than diamond; if that was in pascals already, give {m:g} Pa",
    ),
)
DENSITY = Usual(
    25.0,  # foams are heavier
    3e4,  # the heaviest metals have 2.3e4 kg/m3
    (
        "is lighter than any elastomer; if g/cm3 were meant, multiply by 1000",
        "{field} is {x:g} kg/m3, lighter than any elastomer; if g/cm3 were meant, give {k:g} "
        "(kg/m3)",
    ),
    (
        "is heavier than any metal; densities are in kg/m3",
        "{field} is {x:g} kg/m3, heavier than any metal; if that was in kg/m3 times 1000, give "
        "{m:g} (kg/m3)",
    ),
)
FLUID = Usual(
    0.05,  # hydrogen has 0.08 kg/m3
    3e4,
    (
        "is lighter than any gas; densities are in kg/m3",
        "{field} is {x:g} kg/m3, lighter than any gas; if g/cm3 were meant, give {k:g} (kg/m3)",
    ),
    DENSITY.large,
)
# Directions, and angles of tendons around the arm.
ANGLE, ANGLE_AROUND = (
    Usual(
        0.0,
        2 * math.pi * turns * (1 + 1e-9),
        _NONE,
        (
            "is many turns; if degrees were meant, convert them by numpy.radians",
            "{field} is {x:g} rad, {turns:.3g} turns; if degrees were meant, give {rad:.6g} (rad)",
        ),
    )
    for turns in (1, 2)
)
# The turn of a tendon along the arm: that of 90 degrees is 14 turns if it is in radians.
TURN = Usual(0.0, 2 * math.pi * 10, ANGLE.small, ANGLE.large)
# Over the arm's length: distances of targets from the base, lengths of tendons, and strokes of
# winches, of which shorter ones move no tip that anybody sees.
DISTANCE = Usual(
    3e-3,
    50.0,
    (
        _SMALL,
        f"{{field}} is {{x:.2g}} arm lengths from the base; {_IN_MM}, it is 1000 times too near",
    ),
    (
        _LARGE,
        f"{{field}} is {{x:.3g}} arm lengths from the base; {_IN_M}, it is 1000 times too far",
    ),
)
TENDONS = Usual(
    3e-3,
    50.0,
    (
        _SMALL,
        f"{{field}} are all about {{x:.2g}} arm lengths; {_IN_MM}, they are 1000 times too short",
    ),
    (
        _LARGE,
        f"{{field}} are all about {{x:.3g}} arm lengths; {_IN_M}, they are 1000 times too long",
    ),
)
STROKE = Usual(
    3e-4,
    50.0,
    (_SMALL, f"{{field}} is {{x:.2g}} arm lengths or less; {_IN_MM}, it is 1000 times too little"),
    (_LARGE, f"{{field}} is {{x:.3g}} arm lengths; {_IN_M}, it is 1000 times too much"),
)
# Acceleration of gravity [m/s2], up to ten times that of Earth.
GRAVITY = Usual(
    0.0,
    100.0,
    _NONE,
    (
        "is far above that of Earth; it is in m/s2",
        "{field} is {x:g} m/s2, {earth:.3g} times that of Earth; if mm/s2 were meant, give {m:g} "
        "(m/s2)",
    ),
)
# Speed of a stream [m/s]: no arm is used in faster ones.
SPEED = Usual(
    0.0,
    100.0,
    _NONE,
    (
        "is faster than any stream around an arm; it is in m/s",
        "{field} is {x:g} m/s; if mm/s were meant, give {m:g} (m/s)",
    ),
)
# Radius over the arm's length.
RADIUS = Usual(
    1e-4,
    1.0,
    (_SMALL, f"{{field}} is {{x:.2g}} arm lengths or less; {_IN_MM}, it is 1000 times too small"),
    (_LARGE, f"{{field}} is {{x:.3g}} arm lengths; {_IN_M}, it is 1000 times too large"),
)
# Tension that bends an arm by 1 rad, of the tendon that bends it least [N]. Moduli from 1e7 to 1e10
# Pa are those of plastics, and a thousand times those of the rubbers that soft arms are made of:
# among them an arm that needs tens of newtons is likely of rubber. Metal rods are stiffer.
PLASTICS = 1e7, 1e10
_STIFF = "makes the arm stiff against its tendons; if it was in pascals already, divide by 1000", ""
STIFF = Usual(0.0, 300.0, _NONE, _STIFF)
STIFF_PLASTIC = Usual(0.0, 20.0, _NONE, _STIFF)
# A limit of tensions over the tension that bends the arm by 1 rad: of the tendon with the largest
# such share, and of that with the smallest.
LARGEST_LIMIT = Usual(
    1e-2,
    math.inf,
    (
        "bends the arm by less than 0.01 rad; tensions are in N, moduli in Pa (in files: kPa)",
        "{field} bends the arm by about {x:.1g} rad; tensions are in N, moduli in Pa (in files: "
        "kPa)",
    ),
    _NONE,
)
SMALLEST_LIMIT = Usual(
    0.0,
    1e3,
    _NONE,
    (
        "bends the arm by more than 1000 rad; it is in N, and may be left out for no limit",
        "{field} is at least {x:.2g} times the tension that bends the arm by 1 rad; if "
        "millinewtons were meant, divide by 1000 (N); leave it out for no limit",
    ),
)


def stiff_text(tension: float, modulus: float) -> str:
    """Return the details about an arm that only a large tension [N] bends, by its modulus [Pa]."""
    return (
        f"Material.E is {modulus:g} Pa, so that a tendon needs {tension:.3g} N to bend the arm by "
        f"1 rad; if that was in pascals already, give {modulus / 1e3:g} Pa "
        f"({modulus / 1e6:g} in a key in kPa)"
    )


def warn_unusual(field: str, numbers: Iterable[float], usual: Usual, details: str = "") -> None:
    """Warn of the first number that is too large, or of the largest if all are too small.

    The details are those of `usual` unless given.
    """
    finite = [x for x in numbers if math.isfinite(x)]
    large = next((x for x in finite if abs(x) > usual.most), None)
    x = large if large is not None else max(finite, key=abs, default=0.0)
    if large is not None or 0 < abs(x) < usual.least:
        text, sentence = usual.small if large is None else usual.large
        scaled = {"x": x, "m": x / 1e3, "k": 1e3 * x, "M": 1e6 * x, "earth": x / 9.81}
        angle = {"turns": abs(x) / (2 * math.pi), "rad": math.radians(x)}
        told = details or sentence.format(field=field, **scaled, **angle)
        warn(f"{field} {text}", UnitWarning, told)


def likely_degrees(radians: float) -> str:
    """Return what to give for an angle that is not allowed, if it is likely in degrees."""
    if abs(radians) <= 2 * math.pi or abs(radians) > 360:
        return ""
    return f"; {radians:g} degrees are {math.radians(radians):.6g}"
