"""Arms and scenes as the tables of scene files: what planner.scenes reads, the other way round."""

from __future__ import annotations

from typing import Any

import numpy as np

from model import Anchorage, Arm, InputError, Linear, Sampled, Scene
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)
from model.paths import Path
from planner.scenes.keys import MM

_TABLES: dict[str, tuple[type[Effect], tuple[str, ...]]] = {
    "shear": (Shear, ("k_s",)),
    "weight": (Weight, ("g",)),
    "buoyancy": (Buoyancy, ("density",)),
    "tip_load": (TipLoad, ("force", "moment", "follower")),
    "current": (Current, ("velocity", "density", "coefficient")),
    "friction": (Friction, ("mu", "direction")),
}


def written(arm: Arm, scene: Scene) -> dict[str, Any]:
    """Return the scene file, as TOML is decoded, that has this arm and these effects."""
    return {"arm": _arm(arm), "effects": _effects(scene)}


def _arm(arm: Arm) -> dict[str, Any]:
    frame = np.array(arm.base_frame)
    table = {
        "length_mm": _mm(arm.length),
        "radius_mm": _path(arm.radius),
        "sections": [
            {
                "at_mm": _mm(section.at),
                "offset_mm": _path(section.offset),
                "angles_deg": [_rounded(np.degrees(angle)) for angle in section.angles],
            }
            | _turn(section)
            for section in arm.sections
        ],
        "E_kPa": _rounded(arm.material.E / 1e3),
        "nu": arm.material.nu,
        "density": arm.material.density,
        "base_frame": {"tangent": frame[:, 0].tolist(), "normal": frame[:, 1].tolist()},
        "base_position_mm": [_mm(x) for x in arm.base_position],
    }
    return table | ({"hull_mm": _path(arm.hull)} if arm.hull else {})


def _turn(section: Anchorage) -> dict[str, Any]:
    if section.turn is None:
        return {}
    if not isinstance(section.turn, Linear):
        raise InputError("Anchorage.turn", section.turn, "a Linear path: others have no keys")
    return {"turn_deg": [_rounded(np.degrees(x)) for x in (section.turn.base, section.turn.end)]}


def _path(path: Path) -> Any:
    if isinstance(path, Linear):
        return [_mm(path.base), _mm(path.end)]
    if isinstance(path, Sampled):
        return {"s_mm": [_mm(s) for s in path.s], "values_mm": [_mm(v) for v in path.values]}
    raise InputError("path", path, "a Linear or a Sampled path: others have no keys")


def _effects(scene: Scene) -> dict[str, Any]:
    rubber = scene.find(NeoHookean)
    table: dict[str, Any] = {
        "extension": scene.has(Extension),
        "exact_tendons": scene.has(ExactTendons),
        "neo_hookean": rubber is not None,
        "anticlastic": rubber is not None and rubber.anticlastic,
        "as_printed": scene.has(PrintedStatics),
    }
    for key, (kind, fields) in _TABLES.items():
        effect = scene.find(kind)
        if effect is not None:
            table[key] = {name: _listed(getattr(effect, name)) for name in fields}
    loads = [effect for effect in scene.effects if isinstance(effect, PointLoad)]
    table["point_loads"] = [{"s_mm": _mm(p.s), "force": list(p.force)} for p in loads]
    return table


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _mm(metres: float) -> float:
    return _rounded(metres / MM)


def _rounded(value: float) -> float:
    """Return a number without what a change of units leaves in its last digit."""
    return float(f"{value:.15g}")
