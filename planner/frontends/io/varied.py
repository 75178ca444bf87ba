"""Vary parameters of an arm and a scene by key path, as entries of the tables of a scene file.

Parameters of measurements vary too: positions of markers, scale factors of tensions, and winches.
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
from octoplan.model.extensions.lengths.winches import PLAIN_WINCHES, WinchSettings
from octoplan.model.loads import check_loads
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import UnitWarning
from octoplan.model.support.value import NotNegative, Positive
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
from octoplan.planner.frontends.io.scene_tables import EffectsTable, scene_of, with_defaults


class MarkerTable(Table, frozen=True):
    """Position of a marker on the arm."""

    s_mm: Annotated[float, quantity("arc length from the base", "mm")]
    offset_mm: Annotated[VECTOR, quantity("from the midline in the local frame t, n, b", "mm")] = (
        0.0,
        0.0,
        0.0,
    )


class WinchTable(Table, frozen=True):
    """Winches of the measurements; see WinchSettings."""

    zero_mm: Annotated[tuple[float, ...], quantity("taken in at reading 0, by tendon", "mm")]
    tendon_EA_N: Annotated[Positive | None, quantity("stiffness E A of the tendons", "N")]
    outside_mm: Annotated[NotNegative, quantity("of each tendon, from winch to base", "mm")]


class VariedTable(Table, frozen=True):
    """Parameters that may vary: of the arm, the effects and the measurements."""

    arm: ArmTable
    effects: EffectsTable
    points: Annotated[tuple[MarkerTable, ...], Meta(description="the points of each shape")]
    tension_scale: Annotated[tuple[float, ...], Meta(description="of the tensions, by tendon")]
    winches: WinchTable


class Setting(NamedTuple):
    """A VariedTable as dicts and lists, with all defaults, with arm and scene."""

    table: dict[str, Any]
    arm: Arm
    scene: Scene

    @classmethod
    def of(
        cls,
        arm: Arm,
        scene: Scene,
        points: Iterable[Any] = (),
        winches: WinchSettings = PLAIN_WINCHES,
    ) -> Setting:
        """Return the setting of an arm, a scene, points with `s` and `offset` [m], and winches."""
        scene_file = with_defaults(checked_table(scene_table(arm, scene), "scene"), Path())
        table = {key: scene_file[key] for key in ("arm", "effects")}
        table["points"] = [keys_of(point, MarkerTable) for point in points]
        table["tension_scale"] = [1.0] * arm.n_tendons
        table["winches"] = keys_of(winches, WinchTable)
        table["winches"]["zero_mm"] = table["winches"]["zero_mm"] or [0.0] * arm.n_tendons
        return cls(table, arm, scene)

    def at(
        self, keys: Sequence[str], values: Sequence[Any], near: Setting | None = None
    ) -> Setting:
        """Return the setting with other values at key paths; raise InputError if invalid.

        Unchanged arms and scenes are shared with `near`, by default with this setting.
        """
        table = changed(self.table, keys, values)
        near = near or self
        with warnings.catch_warnings():
            # A search passes through unusual values that the user did not give.
            warnings.simplefilter("ignore", UnitWarning)
            arm = near.arm
            scene = near.scene
            if table["arm"] != near.table["arm"]:
                arm = arm_of(checked(table["arm"], ArmTable, "arm"))
            if table["effects"] != near.table["effects"]:
                scene = scene_of(checked(table["effects"], EffectsTable, "effects"))
        check_loads(arm, scene)
        return Setting(table, arm, scene)

    def check_number(self, key: str) -> None:
        """Raise InputError if the value at a key path is not a number of any sign and size."""
        path = steps(checked_key(self.table, key, VariedTable))
        kinds = kinds_at(VariedTable, self.table, path)
        if value_at(self.table, path) is None or not any(isinstance(k, FloatType) for k in kinds):
            raise InputError("key", key, "a number of arm, effects or measurements")

    def number(self, key: str) -> float:
        """Return the number at a key path, in the unit of the key."""
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
        """Factors of the tensions of each tendon (n_tendons,)."""
        return np.array(self.table["tension_scale"], dtype=float)

    @property
    def winches(self) -> WinchSettings:
        """The winches of the measurements; raise InputError for invalid values."""
        return WinchSettings(**arguments_of(checked(self.table["winches"], WinchTable, "winches")))
