"""The codec: types of what files hold, derived from the classes of the project themselves.

`table` returns the msgspec struct of a class: a key for each argument, with the unit that its
annotation names at the end of the key, its bounds, its default, and what the class's docstring
says of it. An argument whose annotation says not how it is written needs a `Form`; without it the
import fails and names it. Reading and writing go by the same annotations.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta

from model.errors import InputError
from model.paths import Array, Linear, Path, Sampled
from planner.io.annotations import (
    SI,
    UNITS,
    about_type,
    attributes_told,
    choice,
    hints_of,
    is_union,
    quantity,
    suffix,
    unit_of_type,
)

_BOUNDS = ("gt", "ge", "lt", "le")
_LENGTHS = ("min_length", "max_length")

Accuracy = Annotated[float, Meta(ge=1e-12, le=0.1)]
Tensions = list[list[float] | float]


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a file; keys that it does not know are refused."""


@dataclass(frozen=True)
class Form:
    """An argument of a class that is written by keys of its own.

    `keys` has their types and defaults, `read` takes their values in order, `write` returns them.
    """

    keys: Mapping[str, tuple[Any, Any]]
    read: Callable[..., Any]
    write: Callable[[Any], dict[str, Any]]


# How a table is read, and how values of a class are written.
READ: dict[Any, Callable[[Any], Any]] = {}
WRITE: dict[Any, Callable[[Any], dict[str, Any]]] = {}
# What stands for a class in the keys of others: a table, or a choice of several.
TABLES: dict[Any, Any] = {}
# Of tables of classes: their own keys by argument, annotations of these, other arguments' forms.
_KEYS: dict[Any, tuple[Mapping[str, str], Mapping[str, Any], Mapping[str, Form]]] = {}


# Types of files


@cache
def samples(unit: str) -> type[Table]:
    """Return the table of a function of arc length by samples, whose values have a unit."""
    four = {"min_length": 4}
    told = {"s_mm": quantity("arc lengths from the base", "mm", **four)}
    told[f"values{suffix(unit)}"] = quantity("the values there", unit, **four)
    fields = [(key, Annotated[list[float], own]) for key, own in told.items()]
    name = {"mm": "Length", "deg": "Angle", "1/m": "Curvature"}[unit]
    about = "A function of arc length by samples; a cubic spline passes through them."
    found: type[Table] = struct(f"{name}Samples", fields, about)
    return found


def struct(
    name: str,
    fields: list[Any],
    doc: str | None = "",
    tag: str | None = None,
    base: type[msgspec.Struct] = Table,
    **config: Any,
) -> Any:
    """Return the struct of fields, (name, type) or (name, type, default)."""
    config = {"kw_only": True, "frozen": True, **config}
    space = {"__doc__": doc}
    return msgspec.defstruct(name, fields, bases=(base,), namespace=space, tag=tag, **config)


def table(
    kind: Any, *, tag: str | None = None, more: Mapping[str, Any] | None = None, **forms: Form
) -> type[Table]:
    """Return the table by which a class is written; TypeError for arguments without a key.

    Parameters
    ----------
    kind : type
        Whose arguments the keys are; all may be left out where there are keys `more`.
    tag : str
        By which its `type` tells it from others.
    more : mapping
        Keys that are no arguments, with their types and defaults.
    **forms : Form
        Arguments that are written in another way.
    """
    fields: list[Any] = [(key, *own) for key, own in (more or {}).items()]
    own_keys: dict[str, str] = {}
    for name, type_, default in fields_of(kind, skip=forms):
        own_keys[name] = name + suffix(unit_of_type(type_))
        left_out = default is inspect.Parameter.empty and more is not None
        held = (type_ | None, None) if left_out else (type_, default)
        fields.append(
            (own_keys[name], *(own for own in held if own is not inspect.Parameter.empty))
        )
    for form in forms.values():
        fields += [(key, type_, *default) for key, (type_, *default) in form.keys.items()]
    made: type[Table] = struct(f"{kind.__name__}Table", fields, f"See {kind.__name__}.", tag)
    _KEYS[made] = own_keys, hints_of(kind), forms
    READ[made] = lambda given: kind(**arguments_of(given, made))
    WRITE[kind] = lambda value: _keys_of(value, made)
    return made


def fields_of(kind: Any, skip: Container[str] = ()) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, type in files and default there of each argument of a class."""
    told = attributes_told(kind)
    for name, own in inspect.signature(kind).parameters.items():
        if name in skip:
            continue
        hint, default = hints_of(kind)[name], own.default
        unit = unit_of_type(hint)
        try:
            held = type_in_file(hint)
        except TypeError as reason:
            raise TypeError(f"{kind.__name__}.{name} has no key: {reason}") from None
        about = told.get(name, "").replace(f"[{SI.get(unit)}]", f"[{unit}]")
        about += f"; {about_type(hint)}" if about_type(hint) else ""
        if default is not inspect.Parameter.empty:
            default = _hashable(written(default, unit))
        yield name, Annotated[held, Meta(description=about, extra={"unit": unit})], default


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def type_in_file(hint: Any, unit: str = "") -> Any:
    """Return the type of what a key holds for an annotation; TypeError for what has none."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        inner, *more = inside
        unit = unit_of_type(hint) or unit
        bounds = {key: own for meta in more for key, own in _bounds(meta, unit)}
        held = type_in_file(inner, unit)
        size = bounds.get("max_length", 0)
        if size and bounds.get("min_length") == size:
            return tuple[(get_args(held)[0],) * size]  # type: ignore[misc]
        return Annotated[held, Meta(**bounds)] if bounds else held
    if hint is Path:
        return list[float] | samples(unit)
    if is_union(hint) and Path in inside and len(inside) > 1 and type(None) not in inside:
        # Of all tendons of a section, or a list with one for each.
        return list[float | list[float] | samples(unit)] | samples(unit)  # type: ignore[misc]
    if is_union(hint):
        return choice(type_in_file(own, unit) for own in inside)
    if origin is tuple and inside[-1] is Ellipsis:
        return tuple[type_in_file(inside[0], unit), ...]  # type: ignore[misc]
    if origin is tuple or hasattr(hint, "_fields"):
        inside = inside or tuple(hints_of(hint).values())
        return tuple[tuple(type_in_file(own, unit) for own in inside)]  # type: ignore[misc]
    if hint in TABLES:
        return TABLES[hint]
    if hint in (float, int, bool, str, type(None)) or origin is Literal:
        return hint
    raise TypeError(f"{hint} is nothing that files hold")


def _bounds(meta: Any, unit: str) -> Iterator[tuple[str, Any]]:
    """Yield the bounds of an annotation, those of numbers in a unit."""
    for key in (*_BOUNDS, *_LENGTHS):
        own = getattr(meta, key, None)
        if own is not None:
            yield key, number_in(own, unit) if key in _BOUNDS else own


# Reading


def value_of(given: msgspec.Struct) -> Any:
    """Return the value of a table; InputError that names a key, or an argument of the class."""
    return READ[type(given)](given)


def arguments_of(given: Table, kind: type[Table] | None = None) -> dict[str, Any]:
    """Return what the keys of a table hold in SI units: the arguments of the class that it writes.

    Of a table that is no class's, by the names of its keys without the unit. It may be read as one
    of a kind of which it has all keys.
    """
    kind = kind or type(given)
    keys, hints, forms = _KEYS.get(kind) or (_without_units(kind), None, {})
    found = {
        name: read(hints[name] if hints else hints_of(kind)[key], getattr(given, key), key)
        for name, key in keys.items()
    }
    for name, form in forms.items():
        found[name] = form.read(*(getattr(given, key) for key in form.keys))
    return found


@cache
def _without_units(kind: Any) -> dict[str, str]:
    hints = hints_of(kind)
    units = {key: unit_of_type(hints[key]).replace("/", "_") for key in hints}
    return {key.removesuffix(f"_{unit}" if unit else ""): key for key, unit in units.items()}


def read(hint: Any, value: Any, key: str = "", unit: str | None = "") -> Any:
    """Return what a key holds as the value that an annotation asks for; lists as tuples.

    Numbers are in the units that annotations name, in SI's with None for the unit.
    """
    origin, inside = get_origin(hint), get_args(hint)
    if value is None:
        return None
    if origin is Annotated:
        inner = unit if unit is None else unit_of_type(hint) or unit
        return read(inside[0], value, key, inner)
    if is_union(hint):
        return read(_chosen(inside, value, unit), value, key, unit)
    if type(value) in READ:
        return value_of(value)
    if hint is float and isinstance(value, str):
        return float(value)
    if hint is Path:
        return _read_path(value, key, unit)
    if hint == Array:
        return np.array(value, dtype=float)
    if isinstance(value, list | tuple):
        each = inside[:1] if not inside or inside[-1] is Ellipsis or origin is list else inside
        each = tuple(hints_of(hint).values()) if hasattr(hint, "_fields") else each
        of = each if len(each) == len(value) else (each or (Any,))[:1] * len(value)
        return tuple(read(own, one, key, unit) for own, one in zip(of, value, strict=True))
    return in_si(value, unit)


def _chosen(kinds: tuple[Any, ...], value: Any, unit: str | None) -> Any:
    """Return which of several annotations a value is of: lists of paths hold lists or samples.

    In SI units paths are no lists.
    """
    if Path in kinds and isinstance(value, list | tuple):
        several = unit is None or any(not isinstance(own, float | int) for own in value)
        return next((own for own in kinds if several and own is not Path), Path)
    is_list = isinstance(value, list | tuple)
    fitting = [own for own in kinds if own is not type(None) and _is_list(own) == is_list]
    return next(iter(fitting), next(own for own in kinds if own is not type(None)))


def _is_list(kind: Any) -> bool:
    kind = kind.__origin__ if get_origin(kind) is Annotated else kind
    return get_origin(kind) in (tuple, list) or hasattr(kind, "_fields")


def in_si(value: Any, unit: str | None) -> Any:
    """Return a number in a unit, or numbers in lists, in SI's; what is no number as it is."""
    if isinstance(value, list | tuple):
        return tuple(in_si(own, unit) for own in value)
    if unit in UNITS and isinstance(value, int | float) and not isinstance(value, bool):
        return value * UNITS[unit]
    return value


def _read_path(value: Any, key: str, unit: str | None) -> Path:
    if isinstance(value, Table):
        s, values = (getattr(value, own) for own in value.__struct_fields__)
        return Sampled(in_si(s, "mm"), in_si(values, unit))
    if len(value) != 2:
        end = "tip" if unit == "1/m" else "end"
        keys = ", ".join(f"{own} = [...]" for own in samples(unit).__struct_fields__)
        raise InputError(key, value, f"[base, {end}] or {{ {keys} }}")
    return Linear(*in_si(value, unit))


# Writing


def table_of(value: Any) -> dict[str, Any]:
    """Return the table that is read as a value, as TOML is decoded: keys with their units.

    Raises InputError for a value of a kind that has no keys.
    """
    if type(value) not in WRITE:
        known = ", ".join(sorted(kind.__name__ for kind in WRITE))
        raise InputError("to write", value, f"one of {known}: others have no keys")
    found = WRITE[type(value)](value)
    return {key: own for key, own in found.items() if own is not None}


def _keys_of(value: Any, kind: type[Table]) -> dict[str, Any]:
    keys, hints, forms = _KEYS[kind]
    tag = kind.__struct_config__.tag
    found: dict[str, Any] = {} if tag is None else {"type": tag}
    for name, key in keys.items():
        found[key] = written(getattr(value, name), unit_of_type(hints[name]))
    for name, form in forms.items():
        found |= form.write(getattr(value, name))
    return found


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
        return written((value.base, value.end), unit)
    if isinstance(value, Sampled):
        s, values = samples(unit).__struct_fields__
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
