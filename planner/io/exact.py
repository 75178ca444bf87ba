"""Values exactly as they are: kinds, fields and SI numbers, for what has to be read back the same.

Saved plans and calibrations hold them, and what identifies a computation is made of them. The types
of what is read are derived from the classes, as the codec does for files of people.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from model.effects import ExactTendons
from model.errors import InputError
from model.paths import Array, Linear, Path, Sampled
from model.scene import Scene
from planner.avoidance.rows import Apart, Avoidance, Place
from planner.io.annotations import arguments, choice, hints_of, is_of_project, is_union
from planner.io.codec import READ, WRITE, read, struct
from planner.io.files import versions
from planner.targets import Target

KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (*WRITE, Linear, Sampled, Avoidance, Apart, Place)
}
# Numbers that JSON has none for go by name.
Number = float | Literal["inf", "-inf", "nan"]
# Keys of earlier versions whose values have no effect.
_EARLIER: dict[Any, list[Any]] = {ExactTendons: [("careful", bool, False)]}


def plain(value: Any) -> Any:
    """Return an arm, a scene, a target or what they are made of as dicts, lists and numbers.

    Raises InputError for what is not of the project's own kinds: it could not be read back.
    """
    if KINDS.get(type(value).__name__) is type(value):
        return {"kind": type(value).__name__, **fields_of(value)}
    if isinstance(value, dict):
        return {str(key): plain(own) for key, own in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if type(value) in _PLACED:
        return fields_of(value)
    raise InputError("to save", value, f"one of {', '.join(KINDS)}")


def fields_of(value: Any, names: Iterable[str] = ()) -> dict[str, Any]:
    """Return the arguments that a value was made of, or those of these names, as plain values."""
    return {name: plain(getattr(value, name)) for name in names or arguments(type(value))}


# Classes that the place where they stand tells, so that no kind stands with them.
_PLACED: set[Any] = set()


@cache
def exact(kind: Any, *, placed: bool = False) -> Any:
    """Return the table of what `plain` makes of a class; what has a default may be left out.

    A table tells its kind, unless the place where it stands tells that; then keys that are not
    known are those of other versions.
    """
    if placed:
        _PLACED.add(kind)
    own: list[Any] = list(_EARLIER.get(kind, ()))
    for name, told in inspect.signature(kind).parameters.items():
        type_ = _exact_type(hints_of(kind)[name])
        if told.default is told.empty:
            own.append((name, type_))
        else:
            own.append((name, type_ | UnsetType, UNSET))
    tag = None if placed else kind.__name__
    about = (kind.__doc__ or "").partition("\n")[0]
    strict = {"tag_field": None if placed else "kind", "forbid_unknown_fields": not placed}
    made = struct(f"Exact{kind.__name__}", own, about, tag, msgspec.Struct, **strict)
    READ[made] = lambda given: _made(kind, given)
    return made


def _made(kind: Any, given: Any) -> Any:
    found = {name: getattr(given, name) for name in arguments(kind)}
    own = {
        key: read(hints_of(kind)[key], x, unit=None) for key, x in found.items() if x is not UNSET
    }
    return Scene(*own["effects"]) if kind is Scene else kind(**own)


def _exact_type(hint: Any) -> Any:
    """Return the type of what `plain` makes of an annotation's values."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        held = _exact_type(inside[0])
        return Annotated[held, *inside[1:]] if held is int else held
    if hint is float:
        return Number
    if hint == Array:
        return list[Number]
    if is_union(hint):
        return choice([_exact_type(own) for own in inside])
    if origin is tuple and inside[-1] is Ellipsis:
        return tuple[_exact_type(inside[0]), ...]  # type: ignore[misc]
    if origin is tuple or hasattr(hint, "_fields"):
        return tuple[tuple(map(_exact_type, inside or hints_of(hint).values()))]  # type: ignore[misc]
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, _exact_type(inside[1])]  # type: ignore[misc]
    return choice(exact_choices(hint)) if is_of_project(hint) else hint


def exact_choices(kind: Any) -> list[Any]:
    """Return the tables of a class's values: its own, or those of all kinds that derive from it."""
    if kind is Target:
        return [
            exact(own) for own in KINDS.values() if own.__module__.startswith("planner.targets")
        ]
    if kind is Path:
        return [exact(Linear), exact(Sampled)]
    if kind in KINDS.values():
        return [exact(kind)]
    found = [exact(own) for own in KINDS.values() if issubclass(own, kind)]
    return found or [exact(kind, placed=True)]


def identity(*values: Any) -> str:
    """Return a hash of values and of the versions that compute with them.

    It is the same in every process, and for equal values.
    """
    told = json.dumps([plain(list(values)), versions()], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()
