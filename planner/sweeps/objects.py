"""Sweeps of arms, scenes and targets that are there as objects: what a sweep file would hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from model.arm import Arm
from model.checks import kind
from model.errors import InputError
from model.scene import Scene
from planner.io.codec import written
from planner.io.scene_file import scene_table
from planner.targets.base import Target


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
    given = {"tensions": tensions, "tension_max": tension_max}
    table = scene_table(arm, scene, target, **given, **keys)
    own: dict[str, Any] = {
        "compute": compute or ("settle" if target is None else "plan"),
        "axes": [_axis(key, values) for key, values in axes.items()],
        "seed": seed,
    }
    return {"scene": table, "sweep": own | ({} if draws is None else {"draws": draws})}


def _axis(key: str, values: Any) -> dict[str, Any]:
    own = written(values)
    return {"key": key, **own} if isinstance(values, Mapping) else {"key": key, "values": own}
