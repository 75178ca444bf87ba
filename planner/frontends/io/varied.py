"""An arm and a scene whose numbers vary: as the tables of a scene file, changed at key paths.

Beside them are numbers of what was measured: where markers sit, and what tensions are scaled by.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.inspect import FloatType

from octoplan.model.arm import Arm
from octoplan.model.loads import check_loads
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import UnitWarning
from octoplan.planner.frontends.io.codec import Table, arguments_of, keys_of, quantity, unit_of_type
from octoplan.planner.frontends.io.key_paths import (
    changed,
    checked_key,
    kinds_at,
    steps,
    type_at,
    value_at,
)
from octoplan.planner.frontends.io.mistakes import checked
from octoplan.planner.frontends.io.object_tables import VECTOR, ArmTable, arm_of
from octoplan.planner.frontends.io.scene_file import checked_table, scene_table
from octoplan.planner.frontends.io.scene_tables import EffectsTable, scene_of, whole


class MarkerTable(Table, frozen=True):
    """Where a marker sits on the arm."""

    s_mm: Annotated[float, quantity("arc length from the base", "mm")]
    offset_mm: Annotated[VECTOR, quantity("from the midline in the local frame t, n, b", "mm")] = (
        0.0,
        0.0,
        0.0,
    )


class VariedTable(Table, frozen=True):
    """What may vary: numbers of an arm, of effects, and of what is measured."""

    arm: ArmTable
    effects: EffectsTable
    points: Annotated[tuple[MarkerTable, ...], Meta(description="the points of each shape")]
    tension_scale: Annotated[tuple[float, ...], Meta(description="of the tensions, by tendon")]


class Setting(NamedTuple):
    """A VariedTable as dicts and lists, with all defaults; and the arm and the scene of it."""

    table: dict[str, Any]
    arm: Arm
    scene: Scene

    @classmethod
    def of(cls, arm: Arm, scene: Scene, points: Iterable[Any] = ()) -> Setting:
        """Return the setting of an arm, a scene and points with `s` and `offset` [m]."""
        scene_file = whole(checked_table(scene_table(arm, scene), "scene"), Path())
        table = {key: scene_file[key] for key in ("arm", "effects")}
        table["points"] = [keys_of(point, MarkerTable) for point in points]
        return cls(table | {"tension_scale": [1.0] * arm.n_tendons}, arm, scene)

    def at(
        self, keys: Sequence[str], values: Sequence[Any], near: Setting | None = None
    ) -> Setting:
        """Return the setting with other values at key paths; InputError where no such arm can be.

        An arm or a scene that is as in one nearby, or else as in this one, is the same object.
        """
        table, near = changed(self.table, keys, values), near or self
        with warnings.catch_warnings():
            # Nobody gave these numbers: on its way a search passes any of them.
            warnings.simplefilter("ignore", UnitWarning)
            arm, scene = near.arm, near.scene
            if table["arm"] != near.table["arm"]:
                arm = arm_of(checked(table["arm"], ArmTable, "arm"))
            if table["effects"] != near.table["effects"]:
                scene = scene_of(checked(table["effects"], EffectsTable, "effects"))
        check_loads(arm, scene)
        return Setting(table, arm, scene)

    def check_number(self, key: str) -> None:
        """Raise InputError for a key path that leads to no number that may have any value."""
        path = steps(checked_key(self.table, key, VariedTable))
        kinds = kinds_at(VariedTable, self.table, path)
        if value_at(self.table, path) is None or not any(isinstance(k, FloatType) for k in kinds):
            raise InputError("key", key, "a number of arm, effects or measurement")

    def number(self, key: str) -> float:
        """Return the number at a key path, in its unit."""
        return float(value_at(self.table, steps(key)))

    def unit(self, key: str) -> str:
        """Return the unit of the number at a key path."""
        return unit_of_type(type_at(self.table, steps(key), VariedTable))

    @property
    def points(self) -> list[dict[str, Any]]:
        """`s` and `offset` of each point [m]."""
        return list(map(arguments_of, msgspec.convert(self.table["points"], list[MarkerTable])))

    @property
    def tension_scale(self) -> Array:
        """What the tensions of each tendon are multiplied by (n_tendons,)."""
        return np.array(self.table["tension_scale"], dtype=float)
