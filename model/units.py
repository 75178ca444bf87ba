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


# Lengths of arms [m], moduli [Pa]: nothing that is driven by tendons is outside of these.
_SHORT, _LONG = 2e-3, 30.0
_SOFT, _HARD = 1e3, 2e12
# Density of bodies [kg/m3]: foams are heavier.
_LIGHTEST = 25.0
# Distance of a target from the base, over the arm's length.
_NEAR, _FAR = 3e-3, 50.0
# Strokes of winches, over the arm's length: less moves no tip that anybody sees.
_STROKE = 3e-4


class UnitWarning(UserWarning):
    """A number that was likely given in another unit."""


def warn_of_length(field: str, metres: float) -> None:
    """Warn of an arm's length that is likely in millimetres, or metres taken for them."""
    if metres > _LONG:
        _warn(f"{field} is {metres:g} m; if millimetres were meant, give {metres / 1e3:g} (m)")
    elif metres < _SHORT:
        mm = 1e3 * metres
        message = f"if {mm:g} m were meant, give {mm:g} (m), or {1e3 * mm:g} in a key in mm"
        _warn(f"{field} is {metres:g} m, {mm:g} mm; {message}")


def warn_of_width(field: str, metres: float) -> None:
    """Warn of a body's width that is likely in millimetres, or metres taken for them."""
    if metres > _LONG:
        _warn(f"{field} is {metres:.4g} m wide; if that is in millimetres, unit='mm' was meant")
    elif metres < _SHORT:
        _warn(f"{field} is {1e3 * metres:.4g} mm wide; if that is in metres, unit='m' was meant")


def warn_of_modulus(field: str, pascals: float) -> None:
    """Warn of a modulus that is likely in kPa, or pascals taken for kilopascals."""
    if pascals < _SOFT:
        message = f"if kilopascals were meant, give {1e3 * pascals:g} (Pa)"
        _warn(f"{field} is {pascals:g} Pa, softer than any elastomer; {message}")
    elif pascals > _HARD:
        message = (
            f"if that was in pascals already, give {pascals / 1e3:g} Pa, {pascals / 1e6:g} kPa"
        )
        _warn(f"{field} is {pascals:g} Pa, harder than diamond; {message}")


def warn_of_density(field: str, density: float) -> None:
    """Warn of a body's density that is likely in g/cm3."""
    if density < _LIGHTEST:
        message = f"if g/cm3 were meant, give {1e3 * density:g} (kg/m3)"
        _warn(f"{field} is {density:g} kg/m3, lighter than any elastomer; {message}")


def warn_of_angles(field: str, radians: Iterable[float], usual: int = 1) -> None:
    """Warn of an angle beyond so many turns as are usual, likely in degrees."""
    for angle in radians:
        if abs(angle) > 2 * math.pi * usual * (1 + 1e-9):
            turns = abs(angle) / (2 * math.pi)
            message = f"if degrees were meant, give {math.radians(angle):.6g} (rad)"
            _warn(f"{field} is {angle:g} rad, {turns:.3g} turns; {message}")
            return


def likely_degrees(radians: float) -> str:
    """Return what to give for an angle that is not allowed, if it is likely in degrees."""
    if abs(radians) <= 2 * math.pi or abs(radians) > 360:
        return ""
    return f"; {radians:g} degrees are {math.radians(radians):.6g}"


def warn_of_distance(field: str, share: float) -> None:
    """Warn of a place whose distance from the base over the arm's length is out of proportion."""
    if share > _FAR:
        message = "if millimetres were meant for metres, it is 1000 times too far"
        _warn(f"{field} is {share:.3g} arm lengths from the base; {message}")
    elif 0 < share < _NEAR:
        message = "if metres were meant in a key in mm, it is 1000 times too near"
        _warn(f"{field} is {share:.2g} arm lengths from the base; {message}")


def warn_of_lengths(field: str, shares: Iterable[float]) -> None:
    """Warn of lengths of tendons, over the arm's length, that are all out of proportion."""
    shares = list(shares)
    least, most = min(shares, default=0.0), max(shares, default=0.0)
    if least > _FAR:
        message = "if millimetres were meant for metres, they are 1000 times too long"
        _warn(f"{field} are all {least:.3g} arm lengths or more; {message}")
    elif 0 < most < _NEAR:
        message = "if metres were meant in a key in mm, they are 1000 times too short"
        _warn(f"{field} are all {most:.2g} arm lengths or less; {message}")


def warn_of_strokes(field: str, shares: Iterable[float]) -> None:
    """Warn of strokes, or limits of these, over the arm's length, that are out of proportion."""
    most = max((abs(share) for share in shares if math.isfinite(share)), default=0.0)
    if 0 < most < _STROKE:
        message = "if metres were meant in a key in mm, it is 1000 times too little"
        _warn(f"{field} is {most:.2g} arm lengths or less; {message}")
    elif most > _FAR:
        message = "if millimetres were meant for metres, it is 1000 times too much"
        _warn(f"{field} is up to {most:.3g} arm lengths; {message}")


def _warn(message: str) -> None:
    warn(message, UnitWarning)
