"""Warnings about values that are likely in another unit: millimetres, degrees, kilopascals.

Unusual values are allowed. The warning names the field and the likely mistake. The text is the same
for all values, so that Python shows a warning once for each line of a script; `details` contain the
value and the likely intended one. `warnings.simplefilter("ignore", UnitWarning)` silences the
warnings.
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


# Modules that may be on the call stack between a script and a public function.
_BETWEEN = frozenset(
    {"octoplan.model.support.progress", "octoplan.model.settle", "octoplan.model.support.units"}
)


def called_by_a_script() -> bool:
    """Return whether a script, not another function of octoplan, made a public call."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "") in _BETWEEN:
        frame = frame.f_back
    return frame is None or frame.f_globals.get("__name__", "").split(".")[0] != _OURS


def warn(text: str, category: type[Warning], details: str = "") -> None:
    """Warn at the nearest line outside of octoplan; `details` are for a DetailedWarning."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == _OURS:
        frame = frame.f_back
        level += 1
    detailed = issubclass(category, DetailedWarning)
    message = category(text, details) if detailed else category(text)
    warnings.warn(message, stacklevel=level)


_SENTENCES_IN_MM = ContextVar("sentences tell lengths in mm", default=False)


@contextmanager
def millimetres() -> Iterator[None]:
    """Write lengths in mm inside the block, for messages about files."""
    token = _SENTENCES_IN_MM.set(True)
    try:
        yield
    finally:
        _SENTENCES_IN_MM.reset(token)


def length_text(metres: float) -> str:
    """Return a length as text in m, or in mm inside of `millimetres`."""
    return f"{1e3 * metres:.6g} mm" if _SENTENCES_IN_MM.get() else f"{metres:.6g} m"


class UnitWarning(DetailedWarning):
    """A value that is likely in another unit."""


@dataclass(frozen=True)
class Usual:
    """Usual size of a kind of values, and texts of warnings about other values.

    Details are format strings with the fields `{field}`; the value `{x}`, and the value times 1e-3,
    1e3 and 1e6, `{m}`, `{k}` and `{M}`; for angles `{turns}`, and `{rad}`, the value converted
    from degrees.

    Attributes
    ----------
    least, most : float
        Bounds of the absolute value of usual values.
    small, large : (str, str)
        Warnings about values below and above: constant end of the text, and details.
    """

    least: float
    most: float
    small: tuple[str, str]
    large: tuple[str, str]


_NONE = "", ""
_IN_MM = "if metres were meant in a key in mm"
_IN_M = "if millimetres were meant for metres"
_SMALL = f"is very small; {_IN_MM}, multiply by 1000"
_LARGE = f"is very large; {_IN_M}, divide by 1000"
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
    25.0,  # below the density of foams
    3e4,  # above the density of the heaviest metals, 2.3e4 kg/m3
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
    0.05,  # below the density of hydrogen, 0.08 kg/m3
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
# Twist of a tendon along the arm: 90 degrees, misread as radians, are 14 turns.
TURN = Usual(0.0, 2 * math.pi * 10, ANGLE.small, ANGLE.large)
# Distances of targets from the base, tendon lengths and strokes, over the arm's length. Shorter
# strokes have no visible effect on the tip.
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
# Acceleration of gravity [m/s2], up to ten times Earth's.
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
# Speed of a fluid [m/s]; faster currents are implausible for an arm.
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
# Smallest tension of any tendon that bends the arm by 1 rad [N], and range of moduli [Pa] with a
# lower limit. Moduli of 1e7 to 1e10 Pa are plastics, or rubbers of soft arms with a wrong unit; an
# arm of such a modulus that requires tens of newtons is likely rubber. Metal rods are stiffer.
PLASTICS = 1e7, 1e10
_STIFF = "makes the arm stiff against its tendons; if it was in pascals already, divide by 1000", ""
STIFF = Usual(0.0, 300.0, _NONE, _STIFF)
STIFF_PLASTIC = Usual(0.0, 20.0, _NONE, _STIFF)
# Tension limits over the tension that bends the arm by 1 rad: the largest and the smallest of all
# tendons.
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
    """Return details for an arm that only a large tension [N] bends, with its modulus [Pa]."""
    return (
        f"Material.E is {modulus:g} Pa, so that a tendon needs {tension:.3g} N to bend the arm by "
        f"1 rad; if that was in pascals already, give {modulus / 1e3:g} Pa "
        f"({modulus / 1e6:g} in a key in kPa)"
    )


def warn_unusual(field: str, numbers: Iterable[float], usual: Usual, details: str = "") -> None:
    """Warn about the first value that is too large, or about the largest if all are too small.

    The details are the ones of `usual` unless given.
    """
    finite = [x for x in numbers if math.isfinite(x)]
    large = next((x for x in finite if abs(x) > usual.most), None)
    x = large if large is not None else max(finite, key=abs, default=0.0)
    if large is not None or 0 < abs(x) < usual.least:
        text, sentence = usual.small if large is None else usual.large
        scaled = {"x": x, "m": x / 1e3, "k": 1e3 * x, "M": 1e6 * x, "earth": x / 9.81}
        angle = {"turns": abs(x) / (2 * math.pi), "rad": math.radians(x)}
        text_details = details or sentence.format(field=field, **scaled, **angle)
        warn(f"{field} {text}", UnitWarning, text_details)


def likely_degrees(radians: float) -> str:
    """Return a hint for an angle [rad] out of bounds that is likely in degrees, or ""."""
    if abs(radians) <= 2 * math.pi or abs(radians) > 360:
        return ""
    return f"; {radians:g} degrees are {math.radians(radians):.6g}"
