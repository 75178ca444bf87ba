"""The codec: values of the project as tables of keys with units, derived from the tables' types.

A table is a msgspec struct whose fields are the keys of a file. `written_as` says of which class
it is the table; what the class takes as an argument and the table has no key for is an error when
this package is imported, and so is a public class without a table (`check_all_written`). Reading
and writing go by the same fields: a number is multiplied or divided by the size of its key's unit.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from model.errors import InputError
from model.paths import Linear, Path, Sampled

# Units of keys by their names, as multiples of SI's.
UNITS = {
    "mm": 1e-3,
    "mm/s": 1e-3,
    "mm/s2": 1e-3,
    "g": 1e-3,
    "kPa": 1e3,
    "deg": math.pi / 180,
}

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Accuracy = Annotated[float, Meta(ge=1e-12, le=0.1)]
Vector = tuple[float, float, float]
Tensions = list[list[float] | float]

T = TypeVar("T", bound="type[Table]")


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a file; keys that it does not know are refused."""


class Samples(Table, frozen=True):
    """A function of arc length by samples, at least four; a cubic spline passes through them."""

    s_mm: Annotated[list[float], Meta(min_length=4, description="arc lengths from the base [mm]")]


class LengthSamples(Samples, frozen=True):
    """A length as a function of arc length by samples, at least four; a cubic spline."""

    values_mm: Annotated[list[float], Meta(min_length=4, description="the values there [mm]")]


class AngleSamples(Samples, frozen=True):
    """An angle as a function of arc length by samples, at least four; a cubic spline."""

    values_deg: Annotated[list[float], Meta(min_length=4, description="the angles there [deg]")]


class CurvatureSamples(Samples, frozen=True):
    """A curvature as a function of arc length by samples, at least four; a cubic spline."""

    values: Annotated[list[float], Meta(min_length=4, description="curvatures there [1/m]")]


_SAMPLES: dict[str, type[Samples]] = {
    "mm": LengthSamples,
    "deg": AngleSamples,
    "1/m": CurvatureSamples,
}


def quantity(about: str, unit: str = "", *, path: bool = False, **bounds: Any) -> Meta:
    """Return the annotation of a key: what it holds, its unit, and whether it is a path.

    A path is a function of arc length, [base, end] or samples.
    """
    told = f"{about} [{unit}]".strip() if unit else about
    return Meta(description=told, extra={"unit": unit, "path": path}, **bounds)


def unit_of_type(kind: Any) -> str:
    """Return the unit that the annotations of a key's type name; empty without one."""
    return next((str(own["unit"]) for own in _extras(kind) if own.get("unit")), "")


def _extras(kind: Any) -> list[dict[str, Any]]:
    if get_origin(kind) is Annotated:
        inner, *more = get_args(kind)
        own = [meta.extra for meta in more if isinstance(meta, Meta) and meta.extra]
        return [*own, *_extras(inner)]
    return [found for part in get_args(kind) for found in _extras(part)]


@dataclass(frozen=True)
class Join:
    """An argument of a class that several keys make together, or one key in a way of its own.

    `read` takes the values of the keys in order, `write` returns keys and values.
    """

    keys: tuple[str, ...]
    read: Callable[..., Any]
    write: Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class _Key:
    """A key that is an argument by itself: its name, the argument's, unit, whether a path."""

    name: str
    argument: str
    unit: str
    path: bool


@dataclass(frozen=True)
class _Spec:
    """How a class is written: the keys and joins of its arguments."""

    kind: type
    table: type[Table]
    keys: tuple[_Key, ...]
    joins: dict[str, Join]


_OF_KIND: dict[type, _Spec] = {}
_OF_TABLE: dict[type, _Spec] = {}
_WRITERS: dict[type, Callable[[Any], dict[str, Any]]] = {}


def written_as(kind: type, *, beside: Iterable[str] = (), **joins: Join) -> Callable[[T], T]:
    """Let a table be how a class is written; TypeError for arguments without keys.

    Parameters
    ----------
    kind : type
        Whose arguments the keys are, by name but for the unit at the end of a key.
    beside : iterable of str
        Keys that are no arguments.
    **joins : Join
        Arguments that are made of several keys, or in another way.
    """

    def register(table: T) -> T:
        joined = {*beside, *(key for own in joins.values() for key in own.keys)}
        hints = get_type_hints(table, include_extras=True)
        keys = tuple(_key(name, hints[name]) for name in table.__struct_fields__
                     if name not in joined)  # fmt: skip
        told, wanted = {*joins, *(key.argument for key in keys)}, set(arguments(kind))
        if told != wanted:
            raise TypeError(
                f"{table.__name__} is to be how {kind.__name__} is written: it lacks "
                f"{sorted(wanted - told)}, and has {sorted(told - wanted)} that is no argument"
            )
        _OF_KIND[kind] = _OF_TABLE[table] = _Spec(kind, table, keys, joins)
        return table

    return register


def written_by(kind: type, write: Callable[[Any], dict[str, Any]], *names: str) -> None:
    """Let a function be how a class of these arguments is written; TypeError for others."""
    if arguments(kind) != names:
        raise TypeError(f"{kind.__name__} is written by {names}, and made of {arguments(kind)}")
    _WRITERS[kind] = write


def _key(name: str, hint: Any) -> _Key:
    unit, is_path = unit_of_type(hint), any(own.get("path") for own in _extras(hint))
    return _Key(name, name.removesuffix(f"_{unit.replace('/', '_')}"), unit, is_path)


def arguments(kind: Any) -> tuple[str, ...]:
    """Return the names of what a class is made of."""
    return tuple(inspect.signature(kind).parameters)


def check_all_written(kinds: Iterable[type], what: str, keys: Iterable[type] = ()) -> None:
    """Raise TypeError, when this package is imported, for public classes that have no table.

    `keys` are those that have a key, where being written is not enough.
    """
    known = {*keys} or {*_OF_KIND, *_WRITERS}
    lacking = [kind.__name__ for kind in kinds if kind not in known]
    if lacking:
        raise TypeError(f"{what} without a table in planner.io: {', '.join(lacking)}")


def known_kinds() -> tuple[type, ...]:
    """Return the classes that are written."""
    return (*_OF_KIND, *_WRITERS)


def kind_of(table: type) -> type | None:
    """Return the class that a table writes, None for a table that is none's."""
    spec = next((_OF_TABLE[own] for own in table.__mro__ if own in _OF_TABLE), None)
    return None if spec is None else spec.kind


# Reading


def value_of(table: Table) -> Any:
    """Return the value of a table; InputError that names a key, or an argument of the class."""
    spec = _spec(type(table))
    return spec.kind(**arguments_of(table))


def arguments_of(table: Table) -> dict[str, Any]:
    """Return the arguments of the class that a table writes."""
    spec = _spec(type(table))
    found = {
        key.argument: _read(key.name, getattr(table, key.name), key.unit, key.path)
        for key in spec.keys
    }
    for argument, join in spec.joins.items():
        found[argument] = join.read(*(getattr(table, key) for key in join.keys))
    return found


@cache
def _spec(table: Any) -> _Spec:
    return next(_OF_TABLE[own] for own in table.__mro__ if own in _OF_TABLE)


def _read(name: str, value: Any, unit: str, is_path: bool) -> Any:
    if value is None:
        return None
    if is_path:
        return _read_paths(name, value, unit)
    if isinstance(value, Table):
        return value_of(value)
    return si(value, unit)


def si(value: Any, unit: str) -> Any:
    """Return numbers in a unit, alone or in lists, in SI's; lists as tuples."""
    if isinstance(value, list | tuple):
        return tuple(value_of(v) if isinstance(v, Table) else si(v, unit) for v in value)
    if unit in UNITS and isinstance(value, int | float) and not isinstance(value, bool):
        return value * UNITS[unit]
    return value


def _read_paths(name: str, value: Any, unit: str) -> Any:
    """Return a path, or a tuple of them where a list holds lists or samples."""
    if isinstance(value, list) and any(not isinstance(own, float | int) for own in value):
        return tuple(_read_path(name, own, unit) for own in value)
    return _read_path(name, value, unit)


def _read_path(name: str, value: Any, unit: str) -> Path:
    if isinstance(value, Samples):
        s, values = (getattr(value, key) for key in value.__struct_fields__)
        return Sampled(si(s, "mm"), si(values, unit))
    if not (isinstance(value, list) and len(value) == 2):
        end, keys = "tip" if unit == "1/m" else "end", _SAMPLES[unit].__struct_fields__
        samples = ", ".join(f"{key} = [...]" for key in keys)
        raise InputError(name, value, f"[base, {end}] or {{ {samples} }}")
    return Linear(*si(value, unit))


# Writing


def table_of(value: Any) -> dict[str, Any]:
    """Return the table that is read as a value, as TOML is decoded: keys with their units.

    Raises InputError for a value of a kind that has no keys.
    """
    if type(value) in _WRITERS:
        return _WRITERS[type(value)](value)
    spec = _OF_KIND.get(type(value))
    if spec is None:
        known = ", ".join(sorted(kind.__name__ for kind in (*_OF_KIND, *_WRITERS)))
        raise InputError("to write", value, f"one of {known}: others have no keys")
    tag = spec.table.__struct_config__.tag
    found: dict[str, Any] = {} if tag is None else {"type": tag}
    for key in spec.keys:
        found[key.name] = written(getattr(value, key.argument), key.unit)
    for argument, join in spec.joins.items():
        found |= join.write(getattr(value, argument))
    return {key: own for key, own in found.items() if own is not None}


def written(value: Any, unit: str = "") -> Any:
    """Return a value as it is written under a key of a unit; InputError if it cannot be."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return written(value.tolist(), unit)
    if isinstance(value, int | float):
        return number_in(value, unit)
    if isinstance(value, list | tuple | range):
        return [written(own, unit) for own in value]
    if isinstance(value, dict):
        return {key: written(own, unit) for key, own in value.items()}
    if isinstance(value, Linear):
        return [number_in(value.base, unit), number_in(value.end, unit)]
    if isinstance(value, Sampled):
        s, values = _SAMPLES[unit].__struct_fields__
        return {s: written(value.s, "mm"), values: written(value.values, unit)}
    return table_of(value)


def number_in(value: float, unit: str) -> float:
    """Return a number of SI in a unit: the one of fewest digits that is read as it, or nearest."""
    if unit not in UNITS:
        return value
    size = UNITS[unit]
    for digits in (15, 16, 17):
        found = float(f"{value / size:.{digits}g}")
        if found * size == value:
            return found
    near = value / size
    others = (near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf))
    return next((own for own in others if own * size == value), near)
