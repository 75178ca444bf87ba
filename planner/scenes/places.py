"""Which keys a place in a scene file may hold, read off the types of its tables."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

Step = str | int


def steps(path: str) -> list[Step]:
    """Return the keys and indices of a path such as "effects.point_loads[0].s_mm"."""
    found = re.findall(r"([^.\[\]]+)|\[(\d+)\]", path)
    return [key or int(index) for key, index in found]


def value_at(table: Any, path: list[Step]) -> Any:
    """Return what a file holds at a path, None where it holds nothing."""
    for step in path:
        try:
            table = table[step]
        except (KeyError, IndexError, TypeError):
            return None
    return table


def kinds_at(root: Any, table: Any, path: list[Step]) -> list[Any]:
    """Return the types that are allowed at a path; a table's type chooses among tagged ones."""
    kinds, seen = _alternatives(root), table
    for step in path:
        kinds = [kind for k in _chosen(kinds, seen) for kind in _alternatives(_inside(k, step))]
        seen = value_at(seen, [step])
    return _chosen(kinds, seen)


def description_at(root: Any, table: Any, path: list[Step]) -> str:
    """Return what the key at a path is said to hold; empty where nothing is said."""
    if not path or not isinstance(path[-1], str):
        return ""
    tables = filter(_is_table, kinds_at(root, table, path[:-1]))
    told = (_description(_hints(kind).get(path[-1])) for kind in tables)
    return next(filter(None, told), "")


def _description(kind: Any) -> str:
    if get_origin(kind) in (Union, UnionType):
        return next(filter(None, map(_description, get_args(kind))), "")
    if get_origin(kind) is not Annotated:
        return ""
    inner, *more = get_args(kind)
    own = (meta.description for meta in more if isinstance(meta, msgspec.Meta))
    return next(filter(None, own), None) or _description(inner)


def keys_of(kinds: list[Any]) -> list[str]:
    """Return the keys of those types that are tables."""
    tables = [kind for kind in kinds if _is_table(kind)]
    tags = ["type"] * any(kind.__struct_config__.tag for kind in tables)
    return tags + [field for kind in tables for field in kind.__struct_fields__]


def choices_of(kinds: list[Any]) -> list[Any]:
    """Return the values of those types that are choices."""
    return [value for kind in kinds if get_origin(kind) is Literal for value in get_args(kind)]


def tags_of(kinds: list[Any]) -> list[str]:
    """Return the values of `type` that tell tables apart."""
    return [kind.__struct_config__.tag for kind in kinds if _is_table(kind)]


def places(root: Any, key: str) -> list[str]:
    """Return the tables, by their paths, that have a key; lists of tables as "[[path]]"."""
    return list(dict.fromkeys(_places(root, key, "")))


def _places(kind: Any, key: str, path: str) -> Iterator[str]:
    for table in filter(_is_table, _alternatives(kind)):
        if key in table.__struct_fields__:
            yield path
        hints = _hints(table)
        for name in table.__struct_fields__:
            yield from _places(hints[name], key, f"{path}.{name}" if path else name)


def _alternatives(kind: Any) -> list[Any]:
    """Return the members of a union, bare of what is annotated."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _alternatives(get_args(kind)[0])
    if origin in (Union, UnionType):
        return [member for part in get_args(kind) for member in _alternatives(part)]
    return [] if kind is type(None) else [kind]


def _inside(kind: Any, step: Step) -> Any:
    """Return the type of a table's key or a list's item."""
    if _is_table(kind) and isinstance(step, str):
        return _hints(kind).get(step, type(None))
    if get_origin(kind) in (list, tuple) and isinstance(step, int):
        items = get_args(kind)
        return items[min(step, len(items) - 1)] if items[-1] is not Ellipsis else items[0]
    return type(None)


def _chosen(kinds: list[Any], table: Any) -> list[Any]:
    """Return the types, of tagged ones that alone whose tag the table has, if one has it."""
    tag = table.get("type") if isinstance(table, dict) else None
    return [k for k in kinds if _is_table(k) and tag and k.__struct_config__.tag == tag] or kinds


@lru_cache(maxsize=256)
def _hints(table: Any) -> dict[str, Any]:
    return get_type_hints(table, include_extras=True)


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)
