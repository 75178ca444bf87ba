"""Sweeps of arms, scenes and targets that are there as objects: what a sweep file would hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind
from model.errors import InputError
from model.scene import Scene
from planner.scenes.written_targets import target_table
from planner.targets.base import Target
from planner.unknowns.written import written


def sweep_table(
    arm: Arm,
    axes: Mapping[str, Any] | None,
    scene: Scene | None = None,
    target: Target | Iterable[Target] | None = None,
    *,
    tensions: Any = None,
    tension_max: Any = None,
    compute: str | None = None,
    draws: int | None = None,
    seed: int = 0,
    **keys: Any,
) -> dict[str, Any]:
    """Return what a sweep file would hold, as TOML is decoded; see planner.sweep.

    Raises InputError for what is no Arm or Scene, and a target that has no keys in scene files.
    """
    kind("arm", arm, Arm, "an Arm, or the path of a sweep file")
    kind("scene", scene or Scene(), Scene, "a Scene, such as Scene()")
    if not isinstance(axes, Mapping) or not axes:
        told = 'values by key, such as {"arm.E_kPa": [100.0, 120.0]}'
        raise InputError("axes", axes, told)
    table: dict[str, Any] = written(arm, scene or Scene()) | {k: _plain(v) for k, v in keys.items()}
    if tensions is not None:
        table["tensions"] = _plain(tensions)
    if target is not None:
        several = isinstance(target, tuple | list)
        found = [target_table(own) for own in (target if several else [target])]  # type: ignore[union-attr]
        table |= {"targets": found} if several else {"target": found[0]}
    if tension_max is not None:
        table["limits"] = {"tension_max": _plain(tension_max)} | table.get("limits", {})
    own: dict[str, Any] = {
        "compute": compute or ("settle" if target is None else "plan"),
        "axes": [_axis(key, values) for key, values in axes.items()],
        "seed": seed,
    }
    return {"scene": table, "sweep": own | ({} if draws is None else {"draws": draws})}


def _axis(key: str, values: Any) -> dict[str, Any]:
    if isinstance(values, Mapping):
        return {"key": key, **{name: _plain(own) for name, own in values.items()}}
    return {"key": key, "values": _plain(values)}


def _plain(value: Any) -> Any:
    """Return arrays and tuples as lists, numbers of NumPy's as Python's."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(own) for key, own in value.items()}
    return [_plain(own) for own in value] if isinstance(value, list | tuple | range) else value
