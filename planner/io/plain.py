"""Values exactly as they are: kinds, fields and SI numbers, for what has to be read back the same.

Saved plans and calibrations hold them, and what identifies a computation is made of them.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from typing import Any

import numpy as np

from model.errors import FileError, InputError
from model.material import Material
from model.paths import Linear, Sampled
from model.scene import Scene
from planner.avoidance.rows import Apart, Avoidance, Place
from planner.io.codec import arguments, known_kinds
from planner.io.files import versions
from planner.io.key_paths import hint
from planner.io.mistakes import shown

Number = float | str

KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (*known_kinds(), Material, Linear, Sampled, Avoidance, Apart, Place)
}
# Fields by the names that plans of earlier versions have.
_RENAMED = {("ExactTendons", "careful"): "robust"}


def plain(value: Any) -> Any:
    """Return an arm, a scene, a target or what they are made of as dicts, lists and numbers.

    Raises InputError for what is not of the project's own kinds: it could not be read back.
    """
    if KINDS.get(type(value).__name__) is type(value):
        own = {name: plain(getattr(value, name)) for name in arguments(type(value))}
        return {"kind": type(value).__name__, **own}
    if isinstance(value, dict):
        return {str(key): plain(own) for key, own in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InputError("to save", value, f"one of {', '.join(KINDS)}")


def value(table: Any, file: str, where: str) -> Any:
    """Return what plain made a table of; FileError with the place for anything else."""
    if isinstance(table, list):
        return tuple(value(item, file, f"{where}[{i}]") for i, item in enumerate(table))
    if not isinstance(table, dict):
        return table
    name = table.get("kind")
    if not isinstance(name, str) or name not in KINDS:
        allowed = f"one of {', '.join(KINDS)}{hint(name, list(KINDS))}"
        raise FileError(file, f"{where}.kind", f"got {shown(name)}, allowed is {allowed}")
    table = {_RENAMED.get((name, key), key): own for key, own in table.items()}
    names, optional = arguments(KINDS[name]), _optional(KINDS[name])
    # What need not be given is left out by versions that did not have it yet.
    for key in (table.keys() ^ {"kind", *names}) - (optional - table.keys()):
        told = "missing" if key in names else f"no such key (known here: {', '.join(names)})"
        raise FileError(file, f"{where}.{key}", told)
    own = {key: value(table[key], file, f"{where}.{key}") for key in names if key in table}
    try:
        return Scene(*own["effects"]) if name == "Scene" else KINDS[name](**own)
    except InputError as reason:
        raise FileError.of(reason, file, where) from None
    except (TypeError, AttributeError) as reason:
        raise FileError(file, where, f"not the numbers of a {name}: {reason}") from None


def _optional(kind: Any) -> frozenset[str]:
    known = inspect.signature(kind).parameters.items()
    return frozenset(name for name, own in known if own.default is not inspect.Parameter.empty)


def exact(value: Any) -> Any:
    """Return numbers, alone or in lists, with names for what JSON has none: "inf", "-inf", "nan".

    Floats become the nearest number of JSON, which is read as the same; all else stays.
    """
    if isinstance(value, np.ndarray | np.generic):
        return exact(value.tolist())
    if isinstance(value, list | tuple):
        return [exact(own) for own in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def identity(*values: Any) -> str:
    """Return a hash of values and of the versions that compute with them.

    It is the same in every process, and for equal values.
    """
    told = json.dumps([plain(list(values)), versions()], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()
