"""Arms and scenes as the tables of scene files: what planner.scenes reads, the other way round."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from model import Anchorage, Arm, InputError, Linear, Sampled, Scene
from model.effects import (
    Buoyancy,
    Contact,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PointMass,
    PrintedStatics,
    SelfContact,
    Shear,
    TipLoad,
    Weight,
)
from model.paths import Path
from planner.scenes.keys import MM, G
from planner.scenes.obstacles import obstacle_table

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
                "offset_mm": _each(section.offset, _path),
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
    if arm.rest_curvature is not None:
        rest = {name: getattr(arm.rest_curvature, name) for name in ("n", "b")}
        table["rest_curvature"] = {name: _curvature(path) for name, path in rest.items()}
    return table | ({"hull_mm": _path(arm.hull)} if arm.hull else {})


def _turn(section: Anchorage) -> dict[str, Any]:
    return {} if section.turn is None else {"turn_deg": _each(section.turn, _degrees)}


def _each(given: Path | tuple[Path, ...], one: Callable[[Path], Any]) -> Any:
    return [one(own) for own in given] if isinstance(given, tuple) else one(given)


def _path(path: Path) -> Any:
    return _in_unit(path, "values_mm", _mm)


def _degrees(path: Path) -> Any:
    return _in_unit(path, "values_deg", lambda value: _rounded(np.degrees(value)))


def _curvature(path: Path) -> Any:
    return _in_unit(path, "values", float)


def _in_unit(path: Path, key: str, unit: Callable[[float], float]) -> Any:
    if isinstance(path, Linear):
        return [unit(path.base), unit(path.end)]
    if isinstance(path, Sampled):
        return {"s_mm": [_mm(s) for s in path.s], key: [unit(v) for v in path.values]}
    raise InputError("path", path, "a Linear or a Sampled path: others have no keys")


def _effects(scene: Scene) -> dict[str, Any]:
    rubber = scene.find(NeoHookean)
    table: dict[str, Any] = {
        "extension": scene.has(Extension),
        "exact_tendons": scene.has(ExactTendons),
        "neo_hookean": rubber is not None,
        "anticlastic": rubber is not None and rubber.anticlastic,
        "as_printed": scene.has(PrintedStatics),
        "self_contact": scene.has(SelfContact),
        "contacts": [_contact(own) for own in scene.effects if isinstance(own, Contact)],
    }
    for key, (kind, fields) in _TABLES.items():
        effect = scene.find(kind)
        if effect is not None:
            table[key] = {name: _listed(getattr(effect, name)) for name in fields}
    loads = [effect for effect in scene.effects if isinstance(effect, PointLoad)]
    table["point_loads"] = [{"s_mm": _mm(p.s), "force": list(p.force)} for p in loads]
    masses = [effect for effect in scene.effects if isinstance(effect, PointMass)]
    table["point_masses"] = [
        {"s_mm": _mm(m.s), "mass_g": _rounded(m.mass / G)}
        | ({} if m.offset is None else {"offset_mm": [_mm(x) for x in m.offset]})
        for m in masses
    ]
    return table


def _contact(contact: Contact) -> dict[str, Any]:
    """Return the table of what the arm may lean on; InputError for friction, which has no key."""
    if contact.friction:
        allowed = "0 where arms and scenes are written: friction of contacts has no key yet"
        raise InputError("Contact.friction", contact.friction, allowed)
    return obstacle_table(contact.obstacle)


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _mm(metres: float) -> float:
    return _rounded(metres / MM)


def _rounded(value: float) -> float:
    """Return a number without what a change of units leaves in its last digit."""
    return float(f"{value:.15g}")
