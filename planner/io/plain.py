"""Values exactly as they are: kinds, fields and SI numbers, for what has to be read back the same.

Saved plans and calibrations hold them, and what identifies a computation is made of them.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Iterable
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
from planner.program.limits import Limits
from planner.program.statement import Statement
from planner.solve.search_result import Trial

KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (*known_kinds(), Material, Linear, Sampled, Avoidance, Apart, Place)
}
# What saved results are made of besides; the place where it stands tells what it is.
_RESULTS = (Limits, Statement, Trial)
# Fields by the names that plans of earlier versions have.
_RENAMED = {("ExactTendons", "careful"): "robust"}


def plain(value: Any) -> Any:
    """Return an arm, a scene, a target or what they are made of as dicts, lists and numbers.

    Numbers that JSON has none for go by name: "inf", "-inf", "nan". Raises InputError for what is
    not of the project's own kinds: it could not be read back.
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
    if type(value) in _RESULTS:
        return fields_of(value)
    raise InputError("to save", value, f"one of {', '.join(KINDS)}")


def fields_of(value: Any, names: Iterable[str] = ()) -> dict[str, Any]:
    """Return the arguments that a value was made of, or those of these names, as plain values."""
    return {name: plain(getattr(value, name)) for name in names or arguments(type(value))}


def is_of_project(kind: Any) -> bool:
    """Return whether a type is a class of the project's."""
    return isinstance(kind, type) and kind.__module__.partition(".")[0] in ("model", "planner")


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


def identity(*values: Any) -> str:
    """Return a hash of values and of the versions that compute with them.

    It is the same in every process, and for equal values.
    """
    told = json.dumps([plain(list(values)), versions()], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()
