"""The effects of a scene file, each with a key or a table of its own."""

from __future__ import annotations

import re
from typing import Annotated, Any, get_type_hints

from msgspec import Meta

import model.effects
from model.effects import Contact, Effect, PointLoad, PointMass, PrintedStatics
from model.errors import InputError
from model.scene import Scene
from planner.io.annotations import arguments, attributes_told, sentence
from planner.io.codec import TABLES, WRITE, struct, table, table_of, value_of
from planner.io.obstacle_tables import public

# Keys that enable several effects at once.
BUNDLES = {"silicone": Scene.silicone(), "as_printed": Scene.as_printed()}
_SILICONE = "what a real silicone arm calls for: extension, exact_tendons and neo_hookean"
_SEVERAL = (PointLoad, PointMass, Contact)
_EFFECTS: list[type[Effect]] = public(model.effects, Effect)
# What has no arguments but switches is a switch, with these beside it.
_SWITCHES = [own for own in _EFFECTS if {*get_type_hints(own).values()} <= {bool}]


def _key(kind: type[Effect]) -> str:
    """Return the key of an effect: tip_load of TipLoad, point_loads of PointLoad."""
    if kind is PrintedStatics:
        return "as_printed"
    words = re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()
    plural = "es" if words.endswith("s") else "s"
    return words + plural * (kind in _SEVERAL)


KEYS = {kind: _key(kind) for kind in _EFFECTS}


def _fields() -> list[Any]:
    found: list[Any] = [("silicone", Annotated[bool, Meta(description=_SILICONE)], False)]
    kind: Any
    for kind, key in KEYS.items():
        about = Meta(description=sentence(kind))
        if kind in _SWITCHES:
            found.append((key, Annotated[bool | None, about], None))
            for name, own in attributes_told(kind).items():
                found.append((name, Annotated[bool, Meta(description=own)], False))
            WRITE[kind] = _switch_keys
            continue
        of: Any = TABLES.get(kind) or table(kind)
        several: Any = tuple[of, ...]
        held: tuple[Any, Any] = (several, ()) if kind in _SEVERAL else (of | None, None)
        found.append((key, Annotated[held[0], about], held[1]))
    return found


def _switch_keys(own: Effect) -> dict[str, Any]:
    return {KEYS[type(own)]: True, **{name: getattr(own, name) for name in arguments(type(own))}}


EffectsTable: Any = struct(
    "EffectsTable",
    _fields(),
    "The effects enabled; nothing but bending is simulated unless named here.",
)


def scene_of(given: Any) -> Scene:
    """Return the scene of a table; raises InputError that names a key, or an effect's field."""
    implied = {
        type(own) for key, of in BUNDLES.items() if getattr(given, key) for own in of.effects
    }
    found: list[Effect] = []
    for kind, key in KEYS.items():
        own = getattr(given, key)
        if kind in _SWITCHES:
            found += _switched(given, kind, kind in implied if own is None else own)
            continue
        several = own if isinstance(own, tuple) else () if own is None else (own,)
        found += map(value_of, several)
    return Scene(*found)


def _switched(given: Any, kind: Any, on: bool) -> list[Effect]:
    """Return an effect that is a switch if it is on, with the switches that are its arguments."""
    more = {name: getattr(given, name) for name in arguments(kind)}
    if any(more.values()) and not on:
        name = next(name for name, own in more.items() if own)
        allowed = f"{name} = true with silicone = true or {KEYS[kind]} = true only"
        raise InputError(name, True, allowed)
    return [kind(**more)] * on


def _effects_table(scene: Scene) -> dict[str, Any]:
    found: dict[str, Any] = {"extension": False}
    for effect in scene.effects:
        kind, own = type(effect), table_of(effect)
        if kind in _SWITCHES:
            found |= own
        elif kind in _SEVERAL:
            found.setdefault(KEYS[kind], []).append(own)
        else:
            found[KEYS[kind]] = own
    return found


WRITE[Scene] = _effects_table
