"""Key paths such as "arm.E_kPa" or "tensions[0][2]": found in a scene, checked, and set."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from model.errors import InputError
from planner.scenes.mistakes import hint
from planner.scenes.places import Step, kinds_at, steps
from planner.scenes.tables import SceneTable

_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
_SCALARS = (float, int, str, bool)
_SUFFIXES = {"_mm": "mm", "_deg": "deg", "_kPa": "kPa", "_g": "g"}


def whole(table: SceneTable) -> dict[str, Any]:
    """Return a scene as dicts, lists and values, with all that it has by default."""
    return dict(_lists(msgspec.to_builtins(table)))


def _lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _lists(own) for key, own in value.items()}
    return [_lists(own) for own in value] if isinstance(value, list | tuple) else value


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
        inside = ", ".join(_inside(value, key))
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


def _inside(value: Any, key: str) -> list[str]:
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
    """Return the unit of the value at a key path, as the key or its description tells it."""
    path = steps(key)
    at = max(i for i, step in enumerate(path) if isinstance(step, str))
    name = str(path[at])
    for suffix, unit in _SUFFIXES.items():
        if name.endswith(suffix):
            return unit
    for table in kinds_at(SceneTable, scene, path[:at]):
        if name in getattr(table, "__struct_fields__", ()):
            told = " ".join(_descriptions(get_type_hints(table, include_extras=True)[name]))
            units = re.findall(r"\[([^\],]+)\]", told)
            return units[-1] if units else ""
    return ""


def _descriptions(kind: Any) -> list[str]:
    if get_origin(kind) is not Annotated:
        return []
    bare, *more = get_args(kind)
    own = [meta.description for meta in more if isinstance(meta, Meta) and meta.description]
    return own + _descriptions(bare)
