"""The effects of a scene file, each with a key or a table of its own."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from model import InputError, Scene
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
from planner.scenes.keys import MM, G, NotNegative, Positive, Table, Vector, metres
from planner.scenes.obstacles import ObstacleTable, obstacle_of

_ZERO = (0.0, 0.0, 0.0)
Way = Literal[1, -1]


class ShearTable(Table, frozen=True):
    """See model.effects.Shear."""

    k_s: Annotated[Positive, Meta(description="shear correction factor")] = 1.0


class WeightTable(Table, frozen=True):
    """See model.effects.Weight."""

    g: Annotated[Vector, Meta(description="gravity, base frame [m/s2]")] = (0.0, 0.0, -9.81)


class BuoyancyTable(Table, frozen=True):
    """See model.effects.Buoyancy; goes with weight."""

    density: Annotated[NotNegative, Meta(description="of the fluid [kg/m3]")] = 1000.0


class TipLoadTable(Table, frozen=True):
    """See model.effects.TipLoad."""

    force: Annotated[Vector, Meta(description="[N]")] = _ZERO
    moment: Annotated[Vector, Meta(description="[N m]")] = _ZERO
    follower: Annotated[bool, Meta(description="whether it turns with the tip's frame")] = False


class PointLoadTable(Table, frozen=True):
    """See model.effects.PointLoad."""

    s_mm: Annotated[NotNegative, Meta(description="arc length from the base [mm]")]
    force: Annotated[Vector, Meta(description="base frame [N]")]


class PointMassTable(Table, frozen=True):
    """See model.effects.PointMass; goes with weight."""

    s_mm: Annotated[NotNegative, Meta(description="arc length from the base [mm]")]
    mass_g: Annotated[NotNegative, Meta(description="[g]")]
    offset_mm: Annotated[
        Vector | None, Meta(description="from the midline in the local frame t, n, b [mm]")
    ] = None


class CurrentTable(Table, frozen=True):
    """See model.effects.Current."""

    velocity: Annotated[Vector, Meta(description="of the stream, base frame [m/s]")]
    density: Annotated[NotNegative, Meta(description="of the fluid [kg/m3]")] = 1000.0
    coefficient: Annotated[NotNegative, Meta(description="drag coefficient across the arm")] = 1.1


class FrictionTable(Table, frozen=True):
    """See model.effects.Friction."""

    mu: Annotated[NotNegative, Meta(description="coefficient of friction")]
    direction: Annotated[
        Way | tuple[Way, ...],
        Meta(description="1 pulling in, -1 paying out; for all tendons or one for each"),
    ] = 1


class EffectsTable(Table, frozen=True):
    """The effects enabled; nothing but bending is simulated unless named here."""

    silicone: Annotated[
        bool, Meta(description="what a real silicone arm calls for: all of the next three")
    ] = False
    extension: Annotated[bool, Meta(description="the arm shortens under its tendons")] = False
    exact_tendons: Annotated[bool, Meta(description="tendons with their exact tangent")] = False
    neo_hookean: Annotated[
        bool, Meta(description="rubber of constant volume; with extension and exact_tendons")
    ] = False
    anticlastic: Annotated[
        bool, Meta(description="tendons shift with swelling sections; with neo_hookean")
    ] = False
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
        tuple[ObstacleTable, ...], Meta(description="what the arm may lean on, see obstacles")
    ] = ()
    self_contact: Annotated[
        bool, Meta(description="parts of the arm that meet press each other apart; in settle")
    ] = False
    current: CurrentTable | None = None
    friction: FrictionTable | None = None


_KINDS: dict[str, type[Effect]] = {
    "shear": Shear,
    "weight": Weight,
    "buoyancy": Buoyancy,
    "tip_load": TipLoad,
    "current": Current,
    "friction": Friction,
}


def scene_of(table: EffectsTable) -> Scene:
    """Return the scene of a table; raises InputError that names a key, or an effect's field."""
    rubber = table.neo_hookean or table.silicone
    if table.anticlastic and not rubber:
        allowed = "anticlastic = true with silicone = true or neo_hookean = true only"
        raise InputError("anticlastic", True, allowed)
    called: list[tuple[bool, Effect]] = [
        (table.extension or table.silicone or table.as_printed, Extension()),
        (table.exact_tendons or table.silicone, ExactTendons()),
        (rubber, NeoHookean(table.anticlastic)),
        (table.as_printed, PrintedStatics()),
        (table.self_contact, SelfContact()),
    ]
    tables = [(kind, getattr(table, key)) for key, kind in _KINDS.items()]
    loads = [kind(**msgspec.structs.asdict(own)) for kind, own in tables if own is not None]
    points = [PointLoad(own.s_mm * MM, own.force) for own in table.point_loads]
    masses = [
        PointMass(own.s_mm * MM, own.mass_g * G, own.offset_mm and metres(own.offset_mm))
        for own in table.point_masses
    ]
    touched = [Contact(obstacle_of(own)) for own in table.contacts]
    kept = (effect for wanted, effect in called if wanted)
    return Scene(*kept, *loads, *points, *masses, *touched)
