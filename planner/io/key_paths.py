"""Key paths such as "arm.E_kPa" or "tensions[0][2]": what may stand there, by the tables' types.

Paths are found in a scene, checked, and set; a mistake is told with the nearest key that there is.
"""

from __future__ import annotations

import copy
import difflib
import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from model.errors import InputError
from planner.io.codec import unit_of_type
from planner.io.scene_tables import SceneTable

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


def hint(given: Any, known: list[Any]) -> str:
    """Return "; did you mean ...?" where something known is close to what was given."""
    texts = [text for text in known if isinstance(text, str)]
    if not isinstance(given, str):
        return ""
    starts = [text for text in texts if text.startswith(f"{given}_")]
    near = starts or difflib.get_close_matches(given.lower().replace("-", "_"), texts, 1, 0.6)
    near = near or difflib.get_close_matches(given, texts, 1, 0.6)
    return f'; did you mean "{near[0]}"?' if near else ""


_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
_SCALARS = (float, int, str, bool)


def checked_key(scene: dict[str, Any], key: str) -> str:
    """Return a key path if the scene has a single value there, or could; InputError if not."""
    if not _PATH.fullmatch(key):
        raise InputError("key", key, "a path such as arm.E_kPa, tensions[0][2], target.bend_deg")
    value: Any = scene
    path = steps(key)
    for i, step in enumerate(path):
        here = _shown(path[:i]) or "the scene"
        _check_step(value, step, key, here)
        value = value[step]
    if isinstance(value, dict | list):
        inside = ", ".join(_paths_in(value, key))
        raise InputError("key", key, f"a single value, not all of {key}: {inside or 'none in it'}")
    kinds = kinds_at(SceneTable, scene, path)
    if value is None and not any(k in _SCALARS or get_origin(k) is Literal for k in kinds):
        raise InputError("key", key, f"a value that the scene has; give it {key} first")
    return key


def _check_step(value: Any, step: Step, key: str, here: str) -> None:
    if isinstance(value, dict) and step not in value:
        known = list(value)
        raise InputError("key", key, f"in {here} one of {', '.join(known)}{hint(step, known)}")
    if isinstance(value, list) and not (isinstance(step, int) and step < len(value)):
        allowed = f"[0] to [{len(value) - 1}]" if value else "nothing: the scene has none there"
        raise InputError("key", key, f"in {here} {allowed}")
    if value is None:
        raise InputError("key", key, f"a value that the scene has; give it {here} first")
    if not isinstance(value, dict | list):
        raise InputError("key", key, f"{here}, which is a single value")


def _paths_in(value: Any, key: str) -> list[str]:
    """Return the paths of what is in a table or a list."""
    if isinstance(value, dict):
        return [f"{key}.{own}" for own in value]
    return [f"{key}[{i}]" for i in range(len(value))]


def _shown(path: Sequence[Step]) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def changed(scene: dict[str, Any], keys: Sequence[str], values: Sequence[Any]) -> dict[str, Any]:
    """Return a scene with other values at key paths; what is not on these is that of the given."""
    new, own = dict(scene), set[int]()
    for key, value in zip(keys, values, strict=True):
        *path, last = steps(key)
        place: Any = new
        for step in path:
            if id(place[step]) not in own:
                place[step] = copy.copy(place[step])
                own.add(id(place[step]))
            place = place[step]
        place[last] = value
    return new


def unit_of(scene: dict[str, Any], key: str) -> str:
    """Return the unit of the value at a key path, as the annotation of its last key has it."""
    path = steps(key)
    at, name = max((i, step) for i, step in enumerate(path) if isinstance(step, str))
    tables = filter(_is_table, kinds_at(SceneTable, scene, path[:at]))
    return next(filter(None, (unit_of_type(_hints(own).get(name)) for own in tables)), "")
