"""Key paths such as "arm.E_kPa" or "tensions[0][2]": what may stand there, by the tables' types.

Paths are found in a scene, checked, and set; a mistake is told with the nearest key that there is.
"""

from __future__ import annotations

import copy
import difflib
import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

import msgspec

from model.errors import InputError
from planner.io.annotations import hints_of, is_union, metas, unit_of_type
from planner.io.scene_tables import SceneTable

Step = str | int
_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
_BOUNDS = ("gt", "ge", "lt", "le", "min_length")


class Kind(NamedTuple):
    """A type that may stand somewhere, and the bounds of its numbers or its length."""

    type: Any
    bounds: dict[str, float]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of a table, none of what is no table."""
        return self.type.__struct_fields__ if self.is_table else ()

    @property
    def is_table(self) -> bool:
        """Whether a table is allowed."""
        return isinstance(self.type, type) and issubclass(self.type, msgspec.Struct)

    @property
    def takes_any_key(self) -> bool:
        """Whether a table may have further keys: those of other versions."""
        return self.is_table and not self.type.__struct_config__.forbid_unknown_fields

    @property
    def size(self) -> int | None:
        """How long a list has to be; None of one of any length, and of what is none."""
        items = get_args(self.type) if get_origin(self.type) is tuple else (...,)
        return None if items[-1] is Ellipsis else len(items)

    @property
    def tag(self) -> tuple[str, str] | None:
        """The key by which a table is told from others, and what it holds."""
        config = self.type.__struct_config__ if self.is_table else None
        return None if config is None or config.tag is None else (config.tag_field, config.tag)


def steps(path: str) -> list[Step]:
    """Return the keys and indices of a path such as "effects.point_loads[0].s_mm"."""
    result = re.findall(r"([^.\[\]]+)|\[(\d+)\]", path)
    return [key or int(index) for key, index in result]


def value_at(table: Any, path: list[Step]) -> Any:
    """Return what a file holds at a path, None where it holds nothing."""
    for step in path:
        try:
            table = table[step]
        except (KeyError, IndexError, TypeError):
            return None
    return table


def kinds_at(root: Any, table: Any, path: list[Step]) -> list[Kind]:
    """Return the types that are allowed at a path; a table's type chooses among tagged ones."""
    kinds, seen = list(alternatives(root)), table
    for step in path:
        inside = [type_inside(kind, step) for kind in chosen(kinds, seen)]
        kinds = [kind for item in inside for kind in alternatives(item)]
        seen = value_at(seen, [step])
    return chosen(kinds, seen)


def type_at(table: Any, path: list[Step], root: Any = SceneTable) -> Any:
    """Return the annotated type of the last key on a path; None where no table has it."""
    last = max((i for i, step in enumerate(path) if isinstance(step, str)), default=-1)
    if last < 0:
        return None
    kinds, key = kinds_at(root, table, path[:last]), str(path[last])
    return next((hints_of(item.type)[key] for item in kinds if key in item.keys), None)


def places(root: Any, key: str) -> list[str]:
    """Return the tables, by their paths, that have a key; of tables in tables too."""
    return list(dict.fromkeys(_places(root, key, "")))


def _places(root: Any, key: str, path: str) -> Iterator[str]:
    for kind in alternatives(root):
        if key in kind.keys:
            yield path
        for name in kind.keys:
            yield from _places(hints_of(kind.type)[name], key, f"{path}.{name}" if path else name)


def alternatives(kind: Any) -> Iterator[Kind]:
    """Yield the members of a union, each with its bounds."""
    if is_union(kind):
        for item in get_args(kind):
            yield from alternatives(item)
    elif get_origin(kind) is Annotated:
        bounds = {key: getattr(meta, key) for meta in metas(kind) for key in _BOUNDS}
        result = {key: item for key, item in bounds.items() if item is not None}
        for inner, more in alternatives(kind.__origin__):
            yield Kind(inner, more | result)
    elif kind is not type(None):
        yield Kind(kind, {})


def type_inside(kind: Kind, step: Step) -> Any:
    """Return the type of a table's key or a list's item."""
    if isinstance(step, str) and step in kind.keys:
        return hints_of(kind.type)[step]
    if kind.tag and step == kind.tag[0]:
        return Literal[kind.tag[1]]
    if get_origin(kind.type) in (list, tuple) and isinstance(step, int):
        items = get_args(kind.type)
        return items[min(step, len(items) - 1)] if items[-1] is not Ellipsis else items[0]
    return type(None)


def chosen(kinds: list[Kind], table: Any) -> list[Kind]:
    """Return the types, of tagged ones that alone whose tag the table has, if one has it."""
    if not isinstance(table, dict):
        return kinds
    return [item for item in kinds if item.tag and table.get(item.tag[0]) == item.tag[1]] or kinds


def hint(value: Any, known: Sequence[Any]) -> str:
    """Return "; did you mean ...?" where something known is close to what was given."""
    texts = [text for text in known if isinstance(text, str)]
    if not isinstance(value, str):
        return ""
    starts = [text for text in texts if text.startswith(f"{value}_")]
    near = starts or difflib.get_close_matches(value.lower().replace("-", "_"), texts, 1, 0.6)
    near = near or difflib.get_close_matches(value, texts, 1, 0.6)
    return f'; did you mean "{near[0]}"?' if near else ""


def checked_key(scene: dict[str, Any], key: str) -> str:
    """Return a key path if the scene has a single value there, or could; InputError if not."""
    if not _PATH.fullmatch(key):
        raise InputError("key", key, "a path such as arm.E_kPa, tensions[0][2], target.bend_deg")
    value: Any = scene
    path = steps(key)
    for i, step in enumerate(path):
        text = _refused(value, step, _shown(path[:i]) or "the scene")
        if text:
            raise InputError("key", key, text)
        value = value[step]
    if isinstance(value, dict | list):
        inside = [f"{key}.{item}" for item in value] if isinstance(value, dict) else None
        inside = inside or [f"{key}[{i}]" for i in range(len(value))]
        text = ", ".join(inside) or "none in it"
        raise InputError("key", key, f"a single value, not all of {key}: {text}")
    kinds = [item.type for item in kinds_at(SceneTable, scene, path)]
    if value is None and not any(k in _SCALARS or get_origin(k) is Literal for k in kinds):
        raise InputError("key", key, f"a value that the scene has; give it {key} first")
    return key


_SCALARS = (float, int, str, bool)


def _refused(value: Any, step: Step, here: str) -> str:
    """Return why a step leads nowhere; empty where it leads on."""
    if isinstance(value, dict):
        allowed = list(value)
        return (
            "" if step in value else f"in {here} one of {', '.join(allowed)}{hint(step, allowed)}"
        )
    if isinstance(value, list):
        if isinstance(step, int) and step < len(value):
            return ""
        return f"in {here} " + (f"[0] to [{len(value) - 1}]" if value else _NONE)
    if value is None:
        return f"a value that the scene has; give it {here} first"
    return f"{here}, which is a single value"


_NONE = "nothing: the scene has none there"


def _shown(path: Sequence[Step]) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def changed(scene: dict[str, Any], keys: Sequence[str], values: Sequence[Any]) -> dict[str, Any]:
    """Return a scene with other values at key paths; what is not on these is that of the given."""
    new, copied = dict(scene), set[int]()
    for key, value in zip(keys, values, strict=True):
        *path, last = steps(key)
        place: Any = new
        for step in path:
            if id(place[step]) not in copied:
                place[step] = copy.copy(place[step])
                copied.add(id(place[step]))
            place = place[step]
        place[last] = value
    return new


def unit_of(scene: dict[str, Any], key: str) -> str:
    """Return the unit of the value at a key path, as the annotation of its last key has it."""
    return unit_of_type(type_at(scene, steps(key)))
