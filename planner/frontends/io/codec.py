"""Encode values as tables of files and decode them, directed by class annotations.

There are two forms. Scene files have keys that end in units, such as length_mm. Saved results have
the exact form (`unit=None`): SI numbers with all bits under the argument names. The msgspec
types of both forms are derived in octoplan.planner.frontends.io.tables.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import UNSET, Meta

from octoplan.model.paths import Array, Linear, Path, PiecewiseLinear, Sampled
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.planner.frontends.io.files import versions

# Units in keys: the power of ten that converts a number to SI; None for degrees.
UNITS = {"mm": -3, "mm/s": -3, "mm/s2": -3, "g": -3, "kPa": 3, "deg": None, "deg/s": None}
# SI unit for each unit.
SI = {"mm": "m", "g": "kg", "kPa": "Pa", "deg": "rad", "mm/s": "m/s", "deg/s": "rad/s"}


UNIONS = (Union, UnionType)
_signature = cache(inspect.signature)


def arguments(kind: Any) -> tuple[str, ...]:
    """Return the argument names of a class or a function."""
    return tuple(_signature(kind).parameters)


@cache
def hints_of(kind: Any) -> dict[str, Any]:
    """Return the annotations of a class or a table, with units and bounds."""
    return get_type_hints(kind, include_extras=True)


def is_of_project(kind: Any) -> bool:
    """Return True for a class of this project."""
    return isinstance(kind, type) and kind.__module__.partition(".")[0] == "octoplan"


def is_union(kind: Any) -> bool:
    """Return True for a union type."""
    return get_origin(kind) in UNIONS


def choice(kinds: Iterable[Any]) -> Any:
    """Return the union of types."""
    return Union[tuple(kinds)]  # noqa: UP007  (the types are computed)


def metas(kind: Any) -> Iterator[Meta]:
    """Yield the metadata of an annotation, outermost first."""
    if get_origin(kind) is Annotated:
        yield from (item for item in kind.__metadata__[::-1] if isinstance(item, Meta))
        yield from metas(kind.__origin__)
    elif is_union(kind) or get_origin(kind) in (tuple, list):
        for item in get_args(kind):
            yield from metas(item)


def unit_of_type(kind: Any) -> str:
    """Return the unit in the annotations of a type; empty without a unit."""
    named = (item.extra["unit"] for item in metas(kind) if item.extra and item.extra.get("unit"))
    return next(named, "")


def about_type(kind: Any) -> str:
    """Return the description in the annotations of a type; empty without a description."""
    return next((item.description for item in metas(kind) if item.description), "")


def quantity(about: str, unit: str = "", **bounds: Any) -> Meta:
    """Return the metadata of a key: a description, the unit and bounds."""
    text = f"{about} [{unit}]".strip() if unit else about
    return Meta(description=text, extra={"unit": unit}, **bounds)


def suffix(unit: str) -> str:
    """Return the suffix of keys with a unit; empty for SI units."""
    return f"_{unit.replace('/', '_')}" if unit in UNITS else ""


# Suffixes of keys, and units of the numbers.
ENDS = {"": "", **{suffix(unit): unit for unit in UNITS}}


# Tables and formats


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a file; unknown keys are errors."""


@dataclass(frozen=True)
class FieldFormat:
    """The format of an argument that occupies keys of its own.

    `keys` has the type and default of each key, `read` converts their values in order to the
    argument, `write` returns the keys for a value of the argument.
    """

    keys: Mapping[str, tuple[Any, Any]]
    read: Callable[..., Any]
    write: Callable[[Any], dict[str, Any]]


# Decoders by table, and encoders by class; None for a class that has the exact form only.
READ: dict[Any, Callable[[Any], Any]] = {}
WRITE: dict[Any, Callable[[Any], dict[str, Any]] | None] = {
    Linear: None,
    PiecewiseLinear: None,
    Sampled: None,
}
# Classes of functions of arc length by samples, by the value of the key `interpolation`.
INTERPOLATIONS: dict[str, Any] = {"spline": Sampled, "linear": PiecewiseLinear}
# Classes that are implied by the place in a file; the exact form has no key `kind`.
PLACED: set[Any] = set()
# By table of a class: the key of each argument, the annotations, the formats of other arguments.
KEYS: dict[Any, tuple[Mapping[str, str], Mapping[str, Any], Mapping[str, FieldFormat]]] = {}


def sample_keys(unit: str) -> tuple[str, str]:
    """Return the two keys of a function of arc length given by samples with a unit."""
    return "s_mm", f"values{suffix(unit)}"


# Reading


def value_of(value: msgspec.Struct) -> Any:
    """Return the value of a table; raise InputError with a key or an argument of the class."""
    return READ[type(value)](value)


def arguments_of(value: Table, kind: type[Table] | None = None) -> dict[str, Any]:
    """Return the contents of a table in SI units, as the arguments of its class.

    Without a class, the names are those of the keys without units. `kind` selects another table
    whose keys are a subset.
    """
    kind = kind or type(value)
    keys, hints, forms = KEYS.get(kind) or (names_of(kind), None, {})
    result = {
        name: read(hints[name] if hints else hints_of(kind)[key], getattr(value, key), key)
        for name, key in keys.items()
    }
    for name, form in forms.items():
        result[name] = form.read(*(getattr(value, key) for key in form.keys))
    return result


@cache
def names_of(kind: Any) -> dict[str, str]:
    """Return the keys of a table by name, the key without the unit."""
    hints = hints_of(kind)
    units = {key: unit_of_type(hints[key]).replace("/", "_") for key in hints}
    return {key.removesuffix(f"_{unit}" if unit else ""): key for key, unit in units.items()}


def read(hint: Any, value: Any, key: str = "", unit: str | None = "") -> Any:
    """Return the value of a key as its annotation requires, with tuples for lists.

    Numbers are converted from the unit of the annotation to SI; None as the unit: no conversion.
    """
    if value is None:
        return None
    if hint is float:
        return float(value) if isinstance(value, str) else in_si(value, unit)
    origin, inside, own_unit = _parts(hint)
    if origin is Annotated:
        return read(inside[0], value, key, unit if unit is None else own_unit or unit)
    if origin in UNIONS:
        return read(_chosen(inside, value, unit), value, key, unit)
    if type(value) in READ:
        return value_of(value)
    if hint is Path:
        return _read_path(value, key, unit)
    if hint == Array:
        return np.array(value, dtype=float)
    if isinstance(value, list | tuple):
        each = inside[:1] if not inside or inside[-1] is Ellipsis or origin is list else inside
        each = tuple(hints_of(hint).values()) if hasattr(hint, "_fields") else each
        of = each if len(each) == len(value) else (each or (Any,))[:1] * len(value)
        return tuple(read(item, one, key, unit) for item, one in zip(of, value, strict=True))
    return in_si(value, unit)


@cache
def _parts(hint: Any) -> tuple[Any, tuple[Any, ...], str]:
    """Return origin, arguments and unit of an annotation; cached for sweeps of many values."""
    return get_origin(hint), get_args(hint), unit_of_type(hint)


def _chosen(kinds: tuple[Any, ...], value: Any, unit: str | None) -> Any:
    """Return the member of a union that matches a value: a list for lists, otherwise another.

    A list of two numbers is a path. In the exact form paths are tables, never lists.
    """
    is_list = isinstance(value, list | tuple)
    others = [k for k in kinds if k is not type(None)]
    if Path in kinds and is_list:
        several = unit is None or any(not isinstance(item, float | int) for item in value)
        return next((item for item in kinds if several and item is not Path), Path)
    return next((item for item in others if _is_list(item) == is_list), others[0])


def _is_list(kind: Any) -> bool:
    kind = kind.__origin__ if get_origin(kind) is Annotated else kind
    return get_origin(kind) in (tuple, list) or hasattr(kind, "_fields")


def in_si(value: Any, unit: str | None) -> Any:
    """Return a number or nested lists of numbers in SI units; other values are unchanged."""
    if isinstance(value, list | tuple):
        return tuple(in_si(item, unit) for item in value)
    if unit in UNITS and isinstance(value, int | float) and not isinstance(value, bool):
        return _number_in_si(value, unit)
    return value


def _number_in_si(value: float, unit: str) -> float:
    """Return a number in SI units, rounded as a decimal: 6.5 mm gives 0.0065 as in scripts."""
    power = UNITS[unit]
    if power is None:
        return value * (math.pi / 180)
    return float(Decimal(repr(float(value))).scaleb(power))


def _read_path(value: Any, key: str, unit: str | None) -> Path:
    if isinstance(value, Table):
        s, values, interpolation = (getattr(value, item) for item in value.__struct_fields__)
        path: Path = INTERPOLATIONS[interpolation](in_si(s, "mm"), in_si(values, unit))
        return path
    if len(value) != 2:
        end = "tip" if unit == "1/m" else "end"
        keys = ", ".join(f"{item} = [...]" for item in sample_keys(unit or ""))
        raise InputError(key, value, f"[base, {end}] or {{ {keys} }}")
    return Linear(*in_si(value, unit))


def read_exact(kind: Any, table: Any) -> Any:
    """Return the value of a class from a table in the exact form."""
    present = {name: getattr(table, name, UNSET) for name in arguments(kind)}
    values = {
        key: read(hints_of(kind)[key], x, unit=None) for key, x in present.items() if x is not UNSET
    }
    return Scene(*values["effects"]) if kind is Scene else kind(**values)


# Writing


def table_of(value: Any) -> dict[str, Any]:
    """Return the table that is read back as a value, in the types of decoded TOML.

    Raises InputError if the class of the value has no table.
    """
    write = WRITE.get(type(value))
    if write is None:
        allowed = ", ".join(sorted(kind.__name__ for kind in WRITE if WRITE[kind]))
        raise InputError("to write", value, f"one of {allowed}")
    return {key: item for key, item in write(value).items() if item is not None}


def keys_of(value: Any, kind: type[Table]) -> dict[str, Any]:
    """Return the keys and values of a table for a value with attributes of these names."""
    keys, hints, forms = KEYS.get(kind) or (names_of(kind), None, {})
    tag = kind.__struct_config__.tag
    result: dict[str, Any] = {} if tag is None else {"type": tag}
    for name, key in keys.items():
        hint = hints[name] if hints else hints_of(kind)[key]
        result[key] = encode(getattr(value, name), unit_of_type(hint))
    for name, form in forms.items():
        result |= form.write(getattr(value, name))
    return result


def encode(value: Any, unit: str | None = "") -> Any:
    """Return a value as written under a key with a unit; raise InputError for other types."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return encode(value.tolist(), unit)
    if isinstance(value, float) and unit is None:
        return value if math.isfinite(value) else str(value)
    if isinstance(value, int | float):
        return number_in(value, unit or "")
    if unit is None and type(value) in WRITE.keys() | PLACED:
        kind = {} if type(value) in PLACED else {"kind": type(value).__name__}
        return kind | attributes_of(value, arguments(type(value)))
    if isinstance(value, list | tuple | range):
        return [encode(item, unit) for item in value]
    if isinstance(value, dict):
        return {key: encode(item, unit) for key, item in value.items()}
    if unit is None:
        raise InputError("to save", value, f"one of {', '.join(item.__name__ for item in WRITE)}")
    if isinstance(value, Linear):
        return encode((value.base, value.end), unit)
    for interpolation, kind in INTERPOLATIONS.items():
        if isinstance(value, kind):
            s, values = sample_keys(unit)
            keys = {s: encode(value.s, "mm"), values: encode(value.values, unit)}
            return keys if kind is Sampled else keys | {"interpolation": interpolation}
    return table_of(value)


def number_in(value: float, unit: str) -> float:
    """Return an SI number in a unit, by the fewest digits that are read back as the same number."""
    if unit not in UNITS:
        return value
    power = UNITS[unit]
    near = math.degrees(value) if power is None else value * 10.0**-power
    short = [float(f"{near:.{digits}g}") for digits in (15, 16)]
    beside = [near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf)]
    return next((item for item in short + beside if _number_in_si(item, unit) == value), near)


def encode_exact(value: Any) -> Any:
    """Return a value in the exact form; raise InputError for types that cannot be read back."""
    return encode(value, None)


def attributes_of(value: Any, names: Iterable[str]) -> dict[str, Any]:
    """Return attributes of a value in the exact form."""
    return {name: encode_exact(getattr(value, name)) for name in names}


def identity(*values: Any) -> str:
    """Return a hash of values and library versions, equal for equal values in every process."""
    text = json.dumps([encode_exact(values), versions()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
