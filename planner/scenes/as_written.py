"""Errors about SI values, told as the file has them: by its own key, number and unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from model.errors import FileError, InputError
from planner.scenes.mistakes import shown

# By the end of a key: its unit in words, and how much of SI's that is.
_UNITS = {"_mm": ("mm", 1e-3), "_deg": ("degrees", math.pi / 180), "_kPa": ("kPa", 1e3)}
_NUMBER = r"-?\d+(?:\.\d*)?(?:e[+-]?\d+)?"
_SI = {"mm": "m", "degrees": "rad", "kPa": "Pa"}


def as_written(reason: InputError, name: str, key: str, part: Any) -> FileError:
    """Return what is not allowed as an error of the file that said so.

    Parameters
    ----------
    reason : InputError
        Of a value in SI units.
    name, key : str
        The file, and the path of the part of it that was built.
    part : Any
        What the file holds there.
    """
    asked = re.split(r"[. ]", re.sub(r"\[\d+\]", "", reason.field))[-1]
    found = [(path, own) for path, own in _measured(key, part) if _is(own, path, reason.given)]
    named = [
        item for item in found if re.search(rf"\b{re.escape(asked)}(_|\b)", item[0][len(key) :])
    ]
    if not named and len(found) != 1:
        return FileError.of(reason, name, key)
    path, own = (named or found)[0]
    allowed = _in(_unit(path)[0], reason.allowed)
    return FileError(name, path, f"got {shown(own)}, allowed is {allowed}")


def _measured(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield paths and values, lists and numbers, of keys that name a unit."""
    if isinstance(value, dict):
        for key, own in value.items():
            yield from _measured(f"{path}.{key}" if path else key, own)
    elif isinstance(value, list):
        if _unit(path)[0]:
            yield path, value
        for i, own in enumerate(value):
            yield from _measured(f"{path}[{i}]", own)
    elif isinstance(value, int | float) and _unit(path)[0]:
        yield path, value


def _unit(path: str) -> tuple[str, float]:
    last = re.sub(r"(\[\d+\])+$", "", path)
    return next((unit for end, unit in _UNITS.items() if last.endswith(end)), ("", 1.0))


def _is(own: Any, path: str, given: Any) -> bool:
    """Whether a value of the file is the one that was given, or a list of which it is the ends."""
    try:
        wanted = np.asarray(given, dtype=float)
        with np.errstate(over="ignore"):
            found = _unit(path)[1] * np.asarray(own, dtype=float)
    except (TypeError, ValueError):
        return False
    if found.size and found.ndim and wanted.shape == (2,) != found.shape:
        found = found[[0, -1]]
    return found.shape == wanted.shape and np.allclose(found, wanted, 1e-9, 0, equal_nan=True)


def _in(unit: str, allowed: str) -> str:
    """Return what is allowed with SI numbers in the unit of a key."""
    si, size = _SI[unit], next(size for own, size in _UNITS.values() if own == unit)

    def other(found: re.Match[str]) -> str:
        return f"{float(found[1]) / size:.6g} {unit}"

    def others(found: re.Match[str]) -> str:
        return f"[{', '.join(f'{float(own) / size:.6g}' for own in found[1].split(','))}] {unit}"

    text = re.sub(rf"({_NUMBER}) {si}\b", other, allowed)
    text = re.sub(rf"\[({_NUMBER}(?:, *{_NUMBER})*)\](?! {unit})", others, text)
    if unit == "degrees":
        text = re.sub(r"\bpi( rad)?\b", r"180\1", text)
    return re.sub(r"\brad\b", unit, text) if unit == "degrees" else text
