"""Checks of what users hand in, each raising InputError with the name of the field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError

# Sizes of numbers that have a meaning, in SI units; products of a few of them are numbers still.
LARGEST, SMALLEST = 1e30, 1e-30
# Of the length of a unit vector.
_ROUNDING = 1e-15


def finite_array(field: str, value: Any, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return value as a float array of the given shape; None in shape is any size."""
    wanted = "x".join("n" if n is None else str(n) for n in shape) or "scalar"
    array = numbers(field, value, f"numbers of shape {wanted}")
    matches = array.ndim == len(shape) and all(
        n in (None, m) for n, m in zip(shape, array.shape, strict=True)
    )
    if not matches:
        raise InputError(field, f"shape {array.shape}", f"shape {wanted}")
    if not np.all(np.isfinite(array)):
        raise InputError(field, value, "finite numbers")
    if array.size and np.abs(array).max() > LARGEST:
        raise InputError(field, value, f"numbers up to {LARGEST:g} in size")
    return array


def numbers(field: str, value: Any, allowed: str) -> NDArray[np.float64]:
    """Return value as a float array of any shape; strings of digits are not numbers."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if array.size and array.dtype.kind not in "iuf":
        raise InputError(field, value, allowed)
    return array.astype(float)


def kind(field: str, value: Any, wanted: type, allowed: str) -> None:
    """Refuse a value that is not of a type; a class is not one of its values."""
    if isinstance(value, type) or not isinstance(value, wanted):
        raise InputError(field, value, allowed)


def positive(field: str, value: Any) -> float:
    """Return value as a finite float above zero, and not next to it."""
    if type(value) is float and SMALLEST <= value <= LARGEST:
        return value
    number = float(finite_array(field, value, ()))
    if number <= 0:
        raise InputError(field, value, "a number above 0")
    if number < SMALLEST:
        raise InputError(field, value, f"a number from {SMALLEST:g}")
    return number


def not_negative(field: str, value: Any) -> float:
    """Return value as a finite float, zero or above."""
    number = float(finite_array(field, value, ()))
    if number < 0:
        raise InputError(field, value, "0 or a number above it")
    return number


def within(field: str, value: Any, low: float, high: float) -> float:
    """Return value as a float in [low, high]."""
    if type(value) is float and low <= value <= high:
        return value
    number = float(finite_array(field, value, ()))
    if not low <= number <= high:
        raise InputError(field, value, f"a number from {low:g} to {high:g}")
    return number


def unit_vector(field: str, value: Any) -> tuple[float, ...]:
    """Return value as three floats of length 1; what has that to rounding stays as it is."""
    given = finite_array(field, value, (3,))
    scaled = given / (np.abs(given).max() or 1.0)
    length = np.linalg.norm(scaled)
    if not length > 0:
        raise InputError(field, value, "a vector that is not 0")
    is_unit = abs(np.linalg.norm(given) - 1) < _ROUNDING
    return tuple((given if is_unit else scaled / length).tolist())


def vector(field: str, value: Any) -> tuple[float, ...]:
    """Return value as three finite floats."""
    return tuple(finite_array(field, value, (3,)).tolist())
