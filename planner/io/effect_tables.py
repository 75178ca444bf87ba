"""The effects of a scene file, each with a key or a table of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, get_args, get_type_hints

from msgspec import Meta

import model.effects
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
from model.errors import InputError
from model.scene import Scene
from planner.io.codec import (
    NotNegative,
    Positive,
    Table,
    Vector,
    arguments,
    check_all_written,
    kind_of,
    quantity,
    table_of,
    value_of,
    written_as,
    written_by,
)
from planner.io.obstacle_tables import ContactTable, contact_of

_ZERO = (0.0, 0.0, 0.0)
Sign = Literal[1, -1]


@written_as(Shear)
class ShearTable(Table, frozen=True):
    """See model.effects.Shear."""

    k_s: Annotated[Positive, quantity("shear correction factor")] = 1.0


@written_as(Weight)
class WeightTable(Table, frozen=True):
    """See model.effects.Weight."""

    g: Annotated[Vector, quantity("gravity, base frame", "m/s2")] = (0.0, 0.0, -9.81)


@written_as(Buoyancy)
class BuoyancyTable(Table, frozen=True):
    """See model.effects.Buoyancy; goes with weight."""

    density: Annotated[NotNegative, quantity("of the fluid", "kg/m3")] = 1000.0


@written_as(TipLoad)
class TipLoadTable(Table, frozen=True):
    """See model.effects.TipLoad."""

    force: Annotated[Vector, quantity("", "N")] = _ZERO
    moment: Annotated[Vector, quantity("", "N m")] = _ZERO
    follower: Annotated[bool, Meta(description="whether it turns with the tip's frame")] = False


@written_as(PointLoad)
class PointLoadTable(Table, frozen=True):
    """See model.effects.PointLoad."""

    s_mm: Annotated[NotNegative, quantity("arc length from the base", "mm")]
    force: Annotated[Vector, quantity("base frame", "N")]


@written_as(PointMass)
class PointMassTable(Table, frozen=True):
    """See model.effects.PointMass; goes with weight."""

    s_mm: Annotated[NotNegative, quantity("arc length from the base", "mm")]
    mass_g: Annotated[NotNegative, quantity("", "g")]
    offset_mm: Annotated[
        Vector | None, quantity("from the midline in the local frame t, n, b", "mm")
    ] = None


@written_as(Current)
class CurrentTable(Table, frozen=True):
    """See model.effects.Current."""

    velocity: Annotated[Vector, quantity("of the stream, base frame", "m/s")]
    density: Annotated[NotNegative, quantity("of the fluid", "kg/m3")] = 1000.0
    coefficient: Annotated[NotNegative, quantity("drag coefficient across the arm")] = 1.1


@written_as(Friction)
class FrictionTable(Table, frozen=True):
    """See model.effects.Friction."""

    mu: Annotated[NotNegative, quantity("coefficient of friction")]
    direction: Annotated[
        Sign | tuple[Sign, ...],
        Meta(description="1 pulling in, -1 paying out; for all tendons or one for each"),
    ] = 1


class EffectsTable(Table, frozen=True):
    """The effects enabled; nothing but bending is simulated unless named here."""

    silicone: Annotated[
        bool, Meta(description="what a real silicone arm calls for: all of the next three")
    ] = False
    extension: Annotated[
        bool | None,
        Meta(description="the arm shortens under its tendons; so it does as_printed, unless false"),
    ] = None
    exact_tendons: Annotated[bool, Meta(description="tendons with their exact tangent")] = False
    neo_hookean: Annotated[
        bool, Meta(description="rubber of constant volume; with extension and exact_tendons")
    ] = False
    anticlastic: Annotated[
        bool, Meta(description="tendons shift with swelling sections; with neo_hookean")
    ] = False
    robust: Annotated[bool, Meta(description="deprecated, has no effect")] = False
    as_printed: Annotated[
        bool, Meta(description="eqs. (10), (11) of the paper to the letter; no other effects")
    ] = False
    shear: ShearTable | None = None
    weight: WeightTable | None = None
    buoyancy: BuoyancyTable | None = None
    tip_load: TipLoadTable | None = None
    point_loads: tuple[PointLoadTable, ...] = ()
    point_masses: tuple[PointMassTable, ...] = ()
    contacts: Annotated[
        tuple[ContactTable, ...], Meta(description="what the arm may lean on, see obstacles")
    ] = ()
    self_contact: Annotated[
        bool, Meta(description="parts of the arm that meet press each other apart; in settle")
    ] = False
    current: CurrentTable | None = None
    friction: FrictionTable | None = None


@dataclass(frozen=True)
class _Flag:
    """An effect that a key turns on, and the keys of its arguments, which go with that one."""

    key: str
    kind: type[Effect]
    arguments: tuple[str, ...] = ()


_FLAGS = (
    _Flag("extension", Extension),
    _Flag("exact_tendons", ExactTendons, arguments(ExactTendons)),
    _Flag("neo_hookean", NeoHookean, ("anticlastic",)),
    _Flag("as_printed", PrintedStatics),
    _Flag("self_contact", SelfContact),
)


def _flag_keys(flag: _Flag, own: Effect) -> dict[str, Any]:
    return {flag.key: True, **{name: getattr(own, name) for name in flag.arguments}}


for _flag in _FLAGS:
    written_by(_flag.kind, partial(_flag_keys, _flag), *_flag.arguments)


def _kinds(hint: Any) -> list[type[Effect]]:
    """Return the effects that the tables in a key's type write."""
    kind = kind_of(hint) if isinstance(hint, type) else None
    found = [kind] if kind is not None and issubclass(kind, Effect) else []
    return found + [own for part in get_args(hint) for own in _kinds(part)]


# The key of each effect that has a table, or several.
_KEYS = {
    kind: key for key, hint in get_type_hints(EffectsTable).items() for kind in _kinds(hint)
} | {Contact: "contacts"}


def scene_of(table: EffectsTable) -> Scene:
    """Return the scene of a table; raises InputError that names a key, or an effect's field."""
    on = {flag.key: bool(getattr(table, flag.key)) for flag in _FLAGS}
    if table.extension is None:
        on["extension"] = table.silicone or table.as_printed
    for key in ("exact_tendons", "neo_hookean"):
        on[key] = on[key] or table.silicone
    found: list[Effect] = []
    for flag in _FLAGS:
        more = {name: getattr(table, name) for name in flag.arguments}
        given = next((name for name, own in more.items() if own), None)
        if given is not None and not on[flag.key]:
            allowed = f"{given} = true with silicone = true or {flag.key} = true only"
            raise InputError(given, True, allowed)
        found += [flag.kind(**more)] * on[flag.key]
    for kind, key in _KEYS.items():
        own = getattr(table, key)
        tables = own if isinstance(own, tuple) else () if own is None else (own,)
        found += [contact_of(one) if kind is Contact else value_of(one) for one in tables]
    return Scene(*found)


def _effects_table(scene: Scene) -> dict[str, Any]:
    table: dict[str, Any] = {"extension": False}
    for effect in scene.effects:
        key, own = _KEYS.get(type(effect)), table_of(effect)
        if key is None:
            table |= own
        elif key in _MANY:
            table.setdefault(key, []).append(own)
        else:
            table[key] = own
    return table


_MANY = {name for name, default in zip(EffectsTable.__struct_fields__,
         EffectsTable.__struct_defaults__, strict=True) if default == ()}  # fmt: skip
written_by(Scene, _effects_table, "effects")
_PUBLIC = (getattr(model.effects, name) for name in model.effects.__all__)
_KNOWN = {*_KEYS, *(flag.kind for flag in _FLAGS)}
check_all_written([own for own in _PUBLIC if own is not Effect], "effects", _KNOWN)
