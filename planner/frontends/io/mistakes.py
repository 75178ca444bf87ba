"""Errors and warnings for the contents of files: the place, the entry, and what is allowed.

`checked` converts a table to a type and reports the first wrong key. `error_context` reports the
InputError of a class at the key of its argument. `warn_of_slips` warns of likely wrong units.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, TypeVar

import msgspec
import numpy as np
from msgspec import inspect

from octoplan.model.support.errors import FileError, InputError, as_given, shortened
from octoplan.model.support.units import UnitWarning, millimetres, warn
from octoplan.planner.frontends.io.codec import ENDS, about_type, in_si
from octoplan.planner.frontends.io.key_paths import (
    Step,
    described,
    hint,
    keys_in,
    kinds_at,
    places,
    steps,
    tag_of,
    type_at,
    value_at,
)
from octoplan.planner.frontends.io.scene_tables import KEYS

R = TypeVar("R")
_LONG = 60
# Similarity of an unknown key to a key of its own table, see difflib, above which the key is
# misspelt, even if another table has it: "angle_deg" for "angles_deg".
_MISSPELT = 0.8
_WORDS: dict[type[inspect.Type], str] = {
    inspect.IntType: "a whole number",
    inspect.FloatType: "a number",
    inspect.StrType: "text in quotes",
    inspect.BoolType: "true or false",
    inspect.ListType: "a list [...]",
    inspect.VarTupleType: "a list [...]",
}
_SIGNS: dict[str, Any] = {
    "gt": (operator.gt, "above"),
    "ge": (operator.ge, ">="),
    "lt": (operator.lt, "below"),
    "le": (operator.le, "up to"),
}


def checked(table: Any, kind: type[R], name: str, needed: str = "", command: str = "") -> R:
    """Return the contents of a file as a table; raise FileError if a key is missing or wrong.

    `needed` is a key that every file for `command` has.
    """
    if needed and needed not in table:
        such = f"`octoplan new --kind {command} FILE` writes a file that has it"
        raise FileError(name, needed, f"missing; {such}")
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as reason:
        _, _, path = str(reason).rstrip("`").partition(" - at `$")
        raise _mistake(name, table, kind, path.removeprefix(".")) from None


@contextmanager
def error_context(name: str, where: str, part: Any = None) -> Iterator[None]:
    """Raise an InputError of the block as the FileError of a place in a file.

    If `part`, the contents of the file at this place, is given, the error names the key of the
    argument, and lengths are in mm.
    """
    try:
        with nullcontext() if part is None else millimetres():
            yield
    except InputError as reason:
        if isinstance(reason, FileError):
            raise
        raise _as_written(reason, name, where, part) from None


def build_at(name: str, where: str, make: Callable[..., R], *values: Any, part: Any = None) -> R:
    """Return `make(*values)`; report errors at a place in a file, see error_context."""
    with error_context(name, where, part):
        return make(*values)


def _mistake(name: str, table: Any, root: Any, path: str) -> FileError:
    """Return the error for an entry of a file that violates the type `root`, at a path.

    The error names the file, the key and similar keys.
    """
    where = steps(path)
    value = value_at(table, where)
    kinds = kinds_at(root, table, where)
    tables = [kind for kind in kinds if isinstance(kind, inspect.StructType)]
    if isinstance(value, dict) and tables:
        return _wrong_keys(name, path, value, tables, root)
    literals = [kind for kind in kinds if isinstance(kind, inspect.LiteralType)]
    options = list(dict.fromkeys(item for kind in literals for item in kind.values))
    words = [f"one of {', '.join(dict.fromkeys(map(str, options)))}"] if options else []
    words += [_words(kind, value) for kind in kinds if kind not in literals]
    allowed = " or ".join(dict.fromkeys(words))
    about = about_type(type_at(table, where, root))
    if any("a list" in item for item in words) and about:
        allowed += f" {about}" if about.startswith("[") else f" ({_uncapitalised(about)})"
    problem = f"must be {allowed}{hint(value, options)}"
    return FileError(name, path or "the file", problem, shown(value))


def _uncapitalised(text: str) -> str:
    """Return a text with a small first letter, unless the first word is a symbol."""
    return text[0].lower() + text[1:] if text[1:2].islower() or text[1:2] == " " else text


def shown(value: Any) -> str:
    """Return a value as TOML writes it, shortened."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else as_given(value)
    return text if len(text) <= _LONG else f"{text[: _LONG - 4]} ..."


def _words(kind: inspect.Type, value: Any) -> str:
    """Return a description of a type, with the bounds that a value violates."""
    if isinstance(kind, inspect.StructType):
        needs_none = not any(item.required for item in kind.fields)
        example = "{} for the defaults, or a table" if needs_none else "a table { ... }"
        return f"{example} of the keys {', '.join(keys_in(kind))}"
    if isinstance(kind, inspect.TupleType):
        are_numbers = all(isinstance(k, inspect.FloatType) for k in kind.item_types)
        return f"a list of {len(kind.item_types)}{' numbers' * are_numbers}"
    least = getattr(kind, "min_length", None) or 0
    if isinstance(value, list) and len(value) < least:
        return f"a list of at least {least}"
    result = _WORDS.get(type(kind), "something else")
    for key, (holds, words) in _SIGNS.items():
        bound = getattr(kind, key, None)
        if bound is not None and isinstance(value, int | float) and not holds(value, bound):
            result += f" {words} {bound if isinstance(bound, int) else f'{bound:g}'}"
    return result


def _wrong_keys(
    name: str, path: str, entries: dict[str, Any], tables: list[inspect.StructType], root: Any
) -> FileError:
    """Return the error for an unknown or missing key of a table."""
    tags = [tag for tag in map(tag_of, tables) if tag]
    allowed = dict.fromkeys([*(key for key, _ in tags), *(k for of in tables for k in keys_in(of))])
    strict = all(item.forbid_unknown_fields for item in tables)
    unknown = next((key for key in entries if strict and key not in allowed), None)
    where = f"{path}.".removeprefix(".")
    if unknown is not None:
        elsewhere = list(dict.fromkeys(places(described(root), unknown)))
        more = hint(unknown, list(allowed), _MISSPELT)
        if not more and "" in elsewhere:
            more = "; it belongs at the top of the file, above the first [table]"
        elif not more and len(elsewhere) == 1 and elsewhere[0] != path:
            more = f"; it belongs in [{elsewhere[0]}]"
        elif not more and path not in elsewhere:
            more = hint(unknown, list(allowed))
        text = f"no such key{more} (allowed here: {', '.join(allowed)})"
        return FileError(name, f"{where}{shortened(unknown)}", text)
    if tags and entries.get(tags[0][0]) is None:
        text = f"missing: must be one of {', '.join(str(tag) for _, tag in tags)}"
        return FileError(name, f"{where}{tags[0][0]}", text)
    required = (field.name for item in tables for field in item.fields if field.required)
    missing = next((key for key in required if key not in entries), "")
    text = f"missing; {f'[{path}]' if path else 'the file'} needs it"
    return FileError(name, f"{where}{missing}", text)


def _as_written(reason: InputError, name: str, key: str, part: Any) -> FileError:
    """Return the InputError of a class as the error of a file, at the key of the argument.

    Parameters
    ----------
    reason : InputError
        The field names an argument, such as Arm.sections[0].at.
    name, key : str
        The file, and the path of the part of the file that was built.
    part : Any
        The contents of the file at this path.
    """
    if not _FIELD.fullmatch(reason.field):
        return FileError.of(reason, name, key)
    names = steps(reason.field)
    if names[0] in _EFFECTS:
        names[0] = _EFFECTS[names[0]]
    elif names[0] == key or str(names[0])[0].isupper():  # the part, or the class of the part
        del names[0]
    matches = [item for item in _arguments(key, part, names) if item[0] != key]
    if not matches:
        return FileError.of(reason, name, key)
    # If there are several effects of a kind, select the first that has this value.
    fitting = (item for item in matches if len(matches) == 1 or _is_same(item, reason.given))
    path, unit, value = next(fitting, matches[0])
    held = shown(value if unit or isinstance(reason.given, tuple) else reason.given)
    return FileError(name, path, f"must be {reason.allowed}", held)


_FIELD = re.compile(r"\w[\w.\[\]]*")
_EFFECTS: dict[Step, str] = {kind.__name__: key for kind, key in KEYS.items()}


def _is_same(written: tuple[str, str, Any], argument: Any) -> bool:
    """Return True if a number or list of numbers of a file equals a value in SI units."""
    _, unit, value = written
    a = np.array(in_si(value, unit))
    b = np.array(argument)
    return {a.dtype.kind, b.dtype.kind} <= {"i", "f"} and np.array_equal(a, b, equal_nan=True)


def _arguments(
    path: str, value: Any, names: list[Step], unit: str = ""
) -> Iterator[tuple[str, str, Any]]:
    """Yield path, unit and value of the keys at which the names of an argument are found."""
    if not names:
        yield path, unit, value
    elif isinstance(value, dict):
        for end, unit in ENDS.items():
            key = f"{names[0]}{end}"
            if key in value:
                yield from _arguments(f"{path}.{key}", value[key], names[1:], unit)
    elif isinstance(value, list):
        which = range(len(value))
        rest = names
        if isinstance(names[0], int):
            which = range(len(value))[names[0] : names[0] + 1]
            rest = names[1:]
        for i in which:
            yield from _arguments(f"{path}[{i}]", value[i], rest, unit)


# Likely slips. The message contains the number that was probably meant: fractions of pi under a key
# in degrees, densities in g/cm3. A modulus below that of any elastomer is an error, because such an
# arm has no stable shape under tendons.

# Largest rounding error of a fraction of pi, such as 3.14, over pi / 12.
_ROUNDED = 7e-3
# Young's modulus of the softest gels [kPa].
_SOFTEST = 0.3
# Range of the density of water in g/cm3, with salt and temperature.
_WATER = (0.9, 1.1)
_FLUIDS = ("effects.buoyancy.density", "effects.current.density")


def check_modulus(E_kPa: float, name: str) -> None:
    """Raise FileError if Young's modulus was given in MPa or GPa in place of kPa."""
    if E_kPa < _SOFTEST:
        unit, factor = ("megapascals", 1e3) if 1e3 * E_kPa >= _SOFTEST else ("gigapascals", 1e6)
        remedy = f"give {factor * E_kPa:g} if {unit} were meant (kPa)"
        problem = f"must be at least {_SOFTEST:g} kPa, as no elastomer is softer; {remedy}"
        raise FileError(name, "arm.E_kPa", problem, f"{E_kPa:g}")


def warn_of_slips(raw: dict[str, Any]) -> None:
    """Issue a UnitWarning for each likely slip in the contents of a scene file."""
    for path, value in _entries("", raw):
        warn_of_slip(path, value)


def _entries(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield path and value of all keys whose values are not tables."""
    if isinstance(value, dict):
        for key, inside in value.items():
            yield from _entries(f"{path}.{key}".removeprefix("."), inside)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for i, inside in enumerate(value):
            yield from _entries(f"{path}[{i}]", inside)
    else:
        yield path, value


def warn_of_slip(path: str, value: Any) -> None:
    """Issue a UnitWarning if the value or the list of values at a key path is a likely slip."""
    held = value if isinstance(value, list) else [value]
    numbers = [item for item in held if isinstance(item, int | float)]
    if not numbers:
        return
    if path in _FLUIDS and all(_WATER[0] <= item <= _WATER[1] for item in numbers):
        text = f"{path} is {_listed(numbers)} kg/m3, a thousandth of that of water"
        meant = f"if g/cm3 were meant, give {_listed([1e3 * item for item in numbers])} (kg/m3)"
        constant = f"{path} is a thousandth of that of water; if g/cm3 were meant, give kg/m3"
        warn(constant, UnitWarning, f"{text}; {meant}")
    key = next(item for item in reversed(steps(path)) if isinstance(item, str))
    small = all(abs(item) < 7 for item in numbers)
    # Half a degree is a plausible angle.
    fractions = [x for x in numbers if _fraction_of_pi(x) and (2 * x) % 1 > 1e-9]
    if key.endswith("_deg") and small and fractions:
        several = " of which some are fractions" if isinstance(value, list) else " a fraction"
        text = f"a key in degrees holds {_listed(numbers)},{several} of pi ({path})"
        degrees = [_fraction_of_pi(x) or math.degrees(x) for x in numbers]
        constant = f"{path} holds fractions of pi; if radians were meant, give degrees"
        details = f"{text}; if radians were meant, give {_listed(degrees)} (degrees)"
        warn(constant, UnitWarning, details)


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{item:g}" for item in numbers)


def _fraction_of_pi(radians: float) -> float:
    """Return the multiple of 15 degrees that an angle in radians is rounded from; otherwise 0."""
    if not abs(radians) < 7:
        return 0.0
    twelfths = round(radians / (math.pi / 12))
    return 15.0 * twelfths * (abs(radians / (math.pi / 12) - twelfths) < _ROUNDED)
