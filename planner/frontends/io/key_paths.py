"""Key paths such as "arm.E_kPa" or "tensions[0][2]": types, checks and replacement.

Messages suggest the nearest existing key.
"""

from __future__ import annotations

import copy
import difflib
import re
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from msgspec import inspect

from octoplan.model.support.errors import InputError
from octoplan.planner.frontends.io.codec import hints_of
from octoplan.planner.frontends.io.scene_tables import SceneTable

Step = str | int
_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
described = cache(inspect.type_info)
_SCALARS = (inspect.FloatType, inspect.IntType, inspect.StrType, inspect.BoolType)
_ONE = (*_SCALARS, inspect.LiteralType)


def steps(path: str) -> list[Step]:
    """Return the keys and indices of a path such as "effects.point_loads[0].s_mm"."""
    result = re.findall(r"([^.\[\]]+)|\[(\d+)\]", path)
    return [key or int(index) for key, index in result]


def value_at(table: Any, path: list[Step]) -> Any:
    """Return the contents of a file at a path; None if the path does not exist."""
    for step in path:
        try:
            table = table[step]
        except (KeyError, IndexError, TypeError):
            return None
    return table


def alternatives(kind: inspect.Type) -> Iterator[inspect.Type]:
    """Yield the members of a union except None, without annotations."""
    if isinstance(kind, inspect.Metadata):
        yield from alternatives(kind.type)
    elif isinstance(kind, inspect.UnionType):
        for item in kind.types:
            yield from alternatives(item)
    elif not isinstance(kind, inspect.NoneType):
        yield kind


def keys_in(kind: inspect.Type) -> dict[str, inspect.Type]:
    """Return the keys of a table with types; empty for other types."""
    if not isinstance(kind, inspect.StructType):
        return {}
    return {field.encode_name: field.type for field in kind.fields}


def tag_of(kind: inspect.Type) -> tuple[str, Any] | None:
    """Return the key that distinguishes a table from others, and the value; None without one."""
    is_tagged = isinstance(kind, inspect.StructType) and kind.tag_field is not None
    return (kind.tag_field, kind.tag) if is_tagged else None  # type: ignore[attr-defined]


def _inside(kind: inspect.Type, step: Step) -> inspect.Type:
    """Return the type of a key of a table or of an item of a list."""
    tag = tag_of(kind)
    if isinstance(step, str):
        inner = keys_in(kind).get(step, inspect.NoneType())
        return inspect.LiteralType((tag[1],)) if tag and step == tag[0] else inner
    if isinstance(kind, inspect.TupleType):
        return kind.item_types[min(step, len(kind.item_types) - 1)]
    is_list = isinstance(kind, inspect.ListType | inspect.VarTupleType)
    return kind.item_type if is_list else inspect.NoneType()  # type: ignore[attr-defined]


def kinds_at(root: Any, table: Any, path: Sequence[Step]) -> list[inspect.Type]:
    """Return the types that are allowed at a path; tags in the file select among tables."""
    kinds = list(alternatives(described(root)))
    for i in range(len(path) + 1):
        held = value_at(table, list(path[:i]))
        if isinstance(held, dict):
            tags = [(item, tag_of(item)) for item in kinds]
            kinds = [item for item, tag in tags if tag and held.get(tag[0]) == tag[1]] or kinds
        if i < len(path):
            kinds = [each for kind in kinds for each in alternatives(_inside(kind, path[i]))]
    return kinds


def type_at(table: Any, path: list[Step], root: Any = SceneTable) -> Any:
    """Return the annotated type of the last key on a path; None if no table has the key."""
    last = max((i for i, step in enumerate(path) if isinstance(step, str)), default=-1)
    if last < 0:
        return None
    key = str(path[last])
    tables = (item for item in kinds_at(root, table, path[:last]) if key in keys_in(item))
    return next((hints_of(item.cls)[key] for item in tables), None)  # type: ignore[attr-defined]


def places(kind: inspect.Type, key: str, path: str = "") -> Iterator[str]:
    """Yield the paths of the tables inside a table that have a key."""
    for item in alternatives(kind):
        if key in keys_in(item):
            yield path
        for name, inner in keys_in(item).items():
            yield from places(inner, key, f"{path}.{name}".removeprefix("."))


def hint(value: Any, known: Sequence[Any], least: float = 0.6) -> str:
    """Return "; did you mean ...?" with the nearest known text; empty if none is near.

    `least` is the smallest similarity of near texts, see difflib.
    """
    texts = [text for text in known if isinstance(text, str)]
    if not isinstance(value, str):
        return ""
    starts = [text for text in texts if text.startswith(f"{value}_")]
    near = starts or difflib.get_close_matches(value.lower().replace("-", "_"), texts, 1, least)
    near = near or difflib.get_close_matches(value, texts, 1, least)
    return f'; did you mean "{near[0]}"?' if near else ""


def checked_key(scene: dict[str, Any], key: str, root: Any = SceneTable) -> str:
    """Return a key path of a single value that the scene has or may have; raise InputError."""
    if not _PATH.fullmatch(key):
        raise InputError("key", key, "a path such as arm.E_kPa, tensions[0][2], target.bend_deg")
    value: Any = scene
    path = steps(key)
    here = ""
    for step in path:
        refused = _refused(value, step, here or "the scene")
        if refused:
            raise InputError("key", key, refused)
        value = value[step]
        here = f"{here}[{step}]" if isinstance(step, int) else f"{here}.{step}".removeprefix(".")
    if isinstance(value, dict | list):
        ends = [f".{k}" for k in value] if isinstance(value, dict) else range(len(value))
        inside = [f"{key}{end}" if isinstance(end, str) else f"{key}[{end}]" for end in ends]
        text = ", ".join(inside) or "none in it"
        raise InputError("key", key, f"a single value, not all of {key}: {text}")
    if value is None and not any(isinstance(k, _ONE) for k in kinds_at(root, scene, path)):
        raise InputError("key", key, f"a value that the scene has: add {key} to the scene")
    return key


def _refused(value: Any, step: Step, here: str) -> str:
    """Return the reason for which a step of a path is invalid; empty if the step is valid."""
    if isinstance(value, dict):
        allowed = list(value)
        text = f"one of {', '.join(allowed)} in {here}{hint(step, allowed)}"
        return "" if step in value else text
    if isinstance(value, list):
        if isinstance(step, int) and step < len(value):
            return ""
        inside = f"[0] to [{len(value) - 1}]" if value else "nothing: the list is empty"
        return f"in {here} {inside}"
    if value is None:
        return f"a value that the scene has: add {here} to the scene"
    return f"{here}, which is a single value"


def changed(scene: dict[str, Any], keys: Sequence[str], values: Sequence[Any]) -> dict[str, Any]:
    """Return a scene with other values at key paths; everything else is shared with the given."""
    for key, value in zip(keys, values, strict=True):
        scene = _with_value(scene, steps(key), value)
    return scene


def _with_value(table: Any, path: list[Step], value: Any) -> Any:
    """Return a table or a list with another value at a path."""
    if not path:
        return value
    new = copy.copy(table)
    new[path[0]] = _with_value(table[path[0]], path[1:], value)
    return new
