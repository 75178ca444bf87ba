"""Arms, scenes and targets as plain values, and back: a table each, with its kind and fields."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import numpy as np

import model.effects
import model.obstacles
import planner.targets
from model import Anchorage, Arm, InputError, Linear, Material, RestCurvature, Sampled, Scene
from model.errors import FileError
from planner.avoidance.rows import Apart, Avoidance, Place
from planner.scenes.mistakes import hint, shown

_EFFECTS = [getattr(model.effects, name) for name in model.effects.__all__ if name != "Effect"]
_TARGETS = [
    kind
    for kind in (getattr(planner.targets, name) for name in planner.targets.__all__)
    if is_dataclass(kind) and hasattr(kind, "guess_towards")
]
_OBSTACLES = [
    kind
    for kind in (getattr(model.obstacles, name) for name in model.obstacles.__all__)
    if is_dataclass(kind)
]
_ARM = (Arm, Material, Anchorage, Linear, Sampled, RestCurvature)
KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (*_ARM, Scene, *_EFFECTS, *_TARGETS, *_OBSTACLES, Avoidance, Apart, Place)
}

Number = float | str


# Fields by the names that plans of earlier versions have.
_RENAMED = {("ExactTendons", "careful"): "robust"}


def plain(value: Any) -> Any:
    """Return an arm, a scene, a target or what they are made of as dicts, lists and numbers.

    Raises InputError for what is not of the project's own kinds: it could not be read back.
    """
    if is_dataclass(value) and KINDS.get(type(value).__name__) is type(value):
        own = {f.name: plain(getattr(value, f.name)) for f in fields(value)}
        return {"kind": type(value).__name__, **own}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
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
    names = [f.name for f in fields(KINDS[name])]
    # What need not be given is left out by versions that did not have it yet.
    optional = {f.name for f in fields(KINDS[name]) if f.default is not MISSING}
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


def number(x: float) -> Number:
    """Return a number, or its name where JSON has none for it: "inf", "-inf", "nan"."""
    return float(x) if -float("inf") < x < float("inf") else str(float(x))
