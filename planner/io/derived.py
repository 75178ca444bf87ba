"""Records that are derived from the classes of results: a field more is a key more.

Numbers that are not finite are written by name, "inf", "-inf", "nan", and read again as the same;
lists stand for tuples and arrays, records for classes inside.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from model.paths import Array
from planner.io.codec import arguments
from planner.io.plain import is_of_project

_PLAIN = (bool, int, float, str, type(None))

Number = float | Literal["inf", "-inf", "nan"]
C = TypeVar("C")


def record_for(
    name: str,
    of: Any,
    *,
    without: Iterable[str] = (),
    beside: Mapping[str, tuple[Any, Any]] | None = None,
    number: Any = Number,
) -> Any:
    """Return the record of a class: its arguments, with defaults where the class has them.

    `beside` are further keys with their types and defaults; `number` is how a float is written.
    """
    hints, known = get_type_hints(of), inspect.signature(of).parameters
    fields: list[Any] = []
    for own in (own for own in known if own not in {*without}):
        default = known[own].default
        told = (own, written_type(hints[own], number))
        if isinstance(default, tuple):
            fields.append((*told, []))
        else:
            fields.append((*told, default) if isinstance(default, _PLAIN) else told)
    fields += [(key, *own) for key, own in (beside or {}).items()]
    doc = (of.__doc__ or "").partition("\n")[0]
    return msgspec.defstruct(name, fields, namespace={"__doc__": doc}, kw_only=True)


def written_type(hint: Any, number: Any = Number) -> Any:
    """Return the type of what is written for an annotation."""
    origin, inside = get_origin(hint), get_args(hint)
    if hint is float:
        return number
    if hint is int:
        return Annotated[int, Meta(ge=0)]  # results count
    if hint == Array:
        return list[number]
    if origin is tuple and inside[-1] is Ellipsis:
        return list[written_type(inside[0], number)]  # type: ignore[misc]
    if origin is tuple:
        return tuple[tuple(written_type(own, number) for own in inside)]  # type: ignore[misc]
    if origin in (Union, UnionType):
        return Union[tuple(written_type(own, number) for own in inside)]  # noqa: UP007
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, written_type(inside[1], number)]  # type: ignore[misc]
    if is_of_project(hint):
        return record_for(f"{hint.__name__}Record", hint, number=number)
    return hint


def made_from(kind: type[C], record: Any, **others: Any) -> C:
    """Return the value that a record was made of; `others` are what it does not hold."""
    hints = get_type_hints(kind)
    names = [own for own in arguments(kind) if own not in others and hasattr(record, own)]
    return kind(**{own: _read(hints[own], getattr(record, own)) for own in names}, **others)


def _read(hint: Any, value: Any) -> Any:
    origin, inside = get_origin(hint), get_args(hint)
    if value is None:
        return None
    if hint is float:
        return float(value)
    if hint == Array:
        return np.array(value, dtype=float)
    if origin is tuple:
        each = inside[:1] * len(value) if inside[-1] is Ellipsis else inside
        return tuple(_read(own, one) for own, one in zip(each, value, strict=True))
    if origin in (Union, UnionType):
        return _read(next(own for own in inside if own is not type(None)), value)
    return made_from(hint, value) if is_of_project(hint) else value
