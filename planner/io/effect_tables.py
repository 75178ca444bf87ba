"""The effects of a scene file: a key each, which is a switch, a table or several."""

from __future__ import annotations

import re
from typing import Annotated, Any, get_type_hints

from msgspec import Meta

import model.effects
from model.effects import Effect, PrintedStatics
from model.errors import InputError
from model.scene import Scene
from planner.io.codec import WRITE, arguments, table_of, value_of
from planner.io.object_tables import public
from planner.io.tables import TABLES, attributes_told, sentence, struct, table

# Keys that enable several effects at once.
BUNDLES = {"silicone": Scene.silicone(), "as_printed": Scene.as_printed()}
_SILICONE = "what a real silicone arm calls for: extension, exact_tendons and neo_hookean"
_EFFECTS: list[type[Effect]] = [kind for kind in public(model.effects) if kind is not Effect]
# Of those that have a place a scene may have several.
_SEVERAL = [item for item in _EFFECTS if item.place is not Effect.place]
# What has no arguments but switches is a switch, with these beside it.
_SWITCHES = [item for item in _EFFECTS if {*get_type_hints(item).values()} <= {bool}]


def _key(kind: type[Effect]) -> str:
    """Return the key of an effect: tip_load of TipLoad, point_loads of PointLoad."""
    if kind is PrintedStatics:
        return "as_printed"
    words = re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()
    plural = "es" if words.endswith("s") else "s"
    return words + plural * (kind in _SEVERAL)


KEYS = {kind: _key(kind) for kind in _EFFECTS}


def _fields() -> list[Any]:
    result: list[Any] = [("silicone", Annotated[bool, Meta(description=_SILICONE)], False)]
    kind: Any
    for kind, key in KEYS.items():
        about = Meta(description=sentence(kind))
        if kind in _SWITCHES:
            result.append((key, Annotated[bool | None, about], None))
            for name, item in attributes_told(kind).items():
                result.append((name, Annotated[bool, Meta(description=item)], False))
            WRITE[kind] = _switch_keys
            continue
        of: Any = TABLES.get(kind) or table(kind)
        several: Any = tuple[of, ...]
        held: tuple[Any, Any] = (several, ()) if kind in _SEVERAL else (of | None, None)
        result.append((key, Annotated[held[0], about], held[1]))
    return result


def _switch_keys(each: Effect) -> dict[str, Any]:
    return {KEYS[type(each)]: True, **{name: getattr(each, name) for name in arguments(type(each))}}


EffectsTable: Any = struct(
    "EffectsTable",
    _fields(),
    "The effects enabled; nothing but bending is simulated unless named here.",
)


def scene_of(value: Any) -> Scene:
    """Return the scene of a table; raises InputError that names a key, or an effect's field."""
    implied = {
        type(item) for key, of in BUNDLES.items() if getattr(value, key) for item in of.effects
    }
    result: list[Effect] = []
    for kind, key in KEYS.items():
        item = getattr(value, key)
        if kind in _SWITCHES:
            result += _switched(value, kind, kind in implied if item is None else item)
            continue
        several = item if isinstance(item, tuple) else () if item is None else (item,)
        result += map(value_of, several)
    return Scene(*result)


def _switched(value: Any, kind: Any, on: bool) -> list[Effect]:
    """Return an effect that is a switch if it is on, with the switches that are its arguments."""
    more = {name: getattr(value, name) for name in arguments(kind)}
    if any(more.values()) and not on:
        name = next(name for name, item in more.items() if item)
        allowed = f"{name} = true with silicone = true or {KEYS[kind]} = true only"
        raise InputError(name, True, allowed)
    return [kind(**more)] * on


def _effects_table(scene: Scene) -> dict[str, Any]:
    result: dict[str, Any] = {"extension": False}
    for effect in scene.effects:
        kind, item = type(effect), table_of(effect)
        if kind in _SWITCHES:
            result |= item
        elif kind in _SEVERAL:
            result.setdefault(KEYS[kind], []).append(item)
        else:
            result[KEYS[kind]] = item
    return result


WRITE[Scene] = _effects_table
