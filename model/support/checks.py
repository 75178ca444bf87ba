"""Checks of user input; each raises InputError with the name of the field."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any, Literal, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from octoplan.model.support.errors import Described, InputError

# Largest and smallest absolute value of a quantity in SI units; products of several quantities
# within these limits do not overflow or underflow.
LARGEST = 1e30
SMALLEST = 1e-30
# Number of values up to which a message shows an array in place of its shape.
_SHORT = 12


def finite_array(field: str, value: Any, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return a value as a float array of a shape, with None for any size."""
    wanted = numbers_text(shape)
    array = numbers(field, value, wanted)
    matches = array.ndim == len(shape) and all(
        n in (None, m) for n, m in zip(shape, array.shape, strict=True)
    )
    if not matches:
        is_short = array.size <= _SHORT
        raise InputError(field, value if is_short else Described(numbers_text(array.shape)), wanted)
    if not np.all(np.isfinite(array)):
        raise InputError(field, value, "finite numbers" if shape else "a finite number")
    if array.size and np.abs(array).max() > LARGEST:
        allowed = "numbers from" if shape else "a number from"
        raise InputError(field, value, f"{allowed} {-LARGEST:g} to {LARGEST:g}")
    return array


def numbers_text(shape: tuple[int | None, ...]) -> str:
    """Return a description of numbers in an array of a shape, with None for any size."""
    if not shape:
        return "a number"
    if shape == (None,):
        return "a list of numbers"
    return f"{' x '.join('n' if n is None else str(n) for n in shape)} numbers"


def numbers(field: str, value: Any, allowed: str) -> NDArray[np.float64]:
    """Return a value as a float array of any shape.

    Raises InputError for strings, even of digits, and for masked arrays.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if (array.size and array.dtype.kind not in "iuf") or np.ma.is_masked(value):
        raise InputError(field, value, allowed)
    return array.astype(float)


# Descriptions of the values of a type, for messages.
SUCH: dict[Any, str] = {bool: "True or False", str: "text"}


def such(kind: Any) -> str:
    """Return a description of the values of a type."""
    if kind in SUCH:
        return SUCH[kind]
    if get_origin(kind) is Literal:
        return " or ".join(
            f'"{each}"' if isinstance(each, str) else f"{each}" for each in get_args(kind)
        )
    return f"a{'n' * (kind.__name__[0] in 'AEIO')} {kind.__name__}"


def kind(field: str, value: Any, wanted: Any, allowed: str = "") -> Any:
    """Return a value of a type; InputError for other values and for classes."""
    if isinstance(value, type) or not isinstance(value, wanted):
        raise InputError(field, value, allowed or such(wanted))
    return value


def literal(field: str, value: Any, wanted: Any) -> Any:
    """Return a value that is one of the texts or integers of a Literal, or raise InputError."""
    allowed = get_args(wanted)
    is_plain = isinstance(value, str | int | np.integer)
    if is_plain and not isinstance(value, bool) and value in allowed:
        return allowed[allowed.index(value)]
    raise InputError(field, value, such(wanted))


def is_several(value: Any) -> bool:
    """Return whether a value is a sequence, excluding text and arrays without dimensions."""
    is_other = isinstance(value, str | bytes | Mapping | Set)
    holds = hasattr(value, "__len__") and hasattr(value, "__iter__")
    return holds and not is_other and getattr(value, "shape", None) != ()


def arc_lengths(value: Any) -> NDArray[np.float64]:
    """Return arc lengths s (N,) [m] of a scalar or (N,)."""
    array = numbers("s", value, "an arc length, or a list of them")
    return finite_array("s", np.atleast_1d(array), (None,))


def finite(field: str, value: Any) -> float:
    """Return a value as a finite float."""
    if type(value) is float and -LARGEST <= value <= LARGEST:
        return value
    return float(finite_array(field, value, ()))


def positive(field: str, value: Any) -> float:
    """Return a value as a finite float of at least SMALLEST."""
    number = finite(field, value)
    if number <= 0:
        raise InputError(field, value, "a number above 0")
    if number < SMALLEST:
        raise InputError(field, value, f"a number from {SMALLEST:g}")
    return number


def not_negative(field: str, value: Any) -> float:
    """Return a value as a finite float of at least zero."""
    number = finite(field, value)
    if number < 0:
        raise InputError(field, value, "a number >= 0")
    return number


def within(field: str, value: Any, low: float, high: float) -> float:
    """Return a value as a float in [low, high]."""
    number = finite(field, value)
    if not low <= number <= high:
        raise InputError(field, value, f"a number from {low:g} to {high:g}")
    return number


def whole(field: str, value: Any, least: int, most: float = np.inf) -> int:
    """Return a whole number of Python or NumPy as an int in [least, most]."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if is_whole and least <= value <= most:
        return int(value)
    end = f" to {most}" if most < np.inf else ""
    raise InputError(field, value, f"a whole number from {least}{end}")


def flag(field: str, value: Any) -> bool:
    """Return True or False of Python or NumPy as a bool."""
    return bool(kind(field, value, bool | np.bool_, SUCH[bool]))


def unit_vector(field: str, value: Any) -> tuple[float, ...]:
    """Return a vector scaled to length 1, as three floats; unit vectors are not changed."""
    argument = finite_array(field, value, (3,))
    scaled = argument / (np.abs(argument).max() or 1.0)
    length = np.linalg.norm(scaled)
    if not length > 0:
        raise InputError(field, value, "a vector that is not 0")
    is_unit = abs(np.linalg.norm(argument) - 1) < 4 * np.finfo(float).eps
    return tuple((argument if is_unit else scaled / length).tolist())


def orthonormal(
    field: str, value: Any, rounding: float = 1e-9, right_handed: bool = True
) -> tuple[tuple[float, ...], ...]:
    """Return an orthonormal frame (3, 3), by columns, as nested tuples."""
    frame = finite_array(field, value, (3, 3))
    square = np.clip(frame, -2, 2)
    allowed = "a right-handed orthonormal frame" if right_handed else "an orthonormal frame"
    lengths = np.linalg.norm(square, axis=0)
    for k in np.flatnonzero(~np.isclose(lengths**2, 1.0, atol=rounding)).tolist():
        raise InputError(field, value, f"{allowed}; column {k} has length {lengths[k]:.6g}")
    for i, k in ((0, 1), (0, 2), (1, 2)):
        product = float(square[:, i] @ square[:, k])
        if abs(product) > rounding:
            raise InputError(field, value, f"{allowed}; columns {i} and {k} are not orthogonal")
    if right_handed and np.linalg.det(square) < 0:
        raise InputError(field, value, f"{allowed}; this one has det = -1")
    return tuple(map(tuple, frame.tolist()))
