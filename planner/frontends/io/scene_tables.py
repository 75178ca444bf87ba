"""The tables of a scene file: effects, targets, limits and options.

Each effect has a key: a switch, a table, or a list of tables.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
from msgspec import Meta, structs

import octoplan.model.effects
from octoplan.model.effects.base import Effect
from octoplan.model.extensions import public_extensions
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import NotNegative, Positive
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.frontends.io.codec import (
    WRITE,
    Table,
    arguments,
    quantity,
    table_of,
    value_of,
)
from octoplan.planner.frontends.io.object_tables import (
    ArmTable,
    ObstacleTable,
    TargetTable,
    inline_mesh,
    public,
)
from octoplan.planner.frontends.io.tables import (
    TABLES,
    Accuracy,
    Tensions,
    attribute_descriptions,
    sentence,
    struct,
    table,
)

# Keys that enable several effects at once.
BUNDLES = {"silicone": Scene.silicone(), "as_printed": Scene.as_printed()}
_SILICONE = "effects of a silicone arm: extension, exact_tendons and neo_hookean"
_EFFECTS: list[type[Effect]] = sorted(
    (
        kind
        for module in (octoplan.model.effects, *public_extensions())
        for kind in public(module)
        if issubclass(kind, Effect) and kind is not Effect
    ),
    key=lambda kind: kind.__name__,
)
# A scene may have several effects of a class that has a place.
_SEVERAL = [item for item in _EFFECTS if item.place is not Effect.place]
# An effect whose arguments are all bool is a switch; the arguments are further switches.
_SWITCHES = [item for item in _EFFECTS if {*get_type_hints(item).values()} <= {bool}]


def _key(kind: type[Effect]) -> str:
    """Return the key of an effect: tip_load for TipLoad, point_loads for PointLoad."""
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
            for name, item in attribute_descriptions(kind).items():
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
    "The effects of the scene; without any, the arm bends and nothing else.",
)


def scene_of(value: Any) -> Scene:
    """Return the scene of a table; raise InputError with a key or a field of an effect."""
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
    """Return the effect of a switch with further switches as arguments; empty if off."""
    more = {name: getattr(value, name) for name in arguments(kind)}
    if any(more.values()) and not on:
        name = next(name for name, item in more.items() if item)
        allowed = f"true with silicone = true or {KEYS[kind]} = true only"
        raise InputError(name, True, allowed)
    return [kind(**more)] * on


def _effects_table(scene: Scene) -> dict[str, Any]:
    result: dict[str, Any] = {"extension": False}
    for effect in scene.effects:
        kind = type(effect)
        item = table_of(effect)
        if kind in _SWITCHES:
            result |= item
        elif kind in _SEVERAL:
            result.setdefault(KEYS[kind], []).append(item)
        else:
            result[KEYS[kind]] = item
    return result


WRITE[Scene] = _effects_table


Hold = Literal["tension", "length"]
TendonEA = Annotated[Positive | None, quantity("stiffness E A of tendons of held length", "N")]


class LimitsTable(Table, frozen=True):
    """Limits of tensions [N] and strokes [mm]: one number for all tendons, or one per tendon."""

    tension_max: Annotated[NotNegative | Tensions, quantity("", "N")]
    tension_min: Annotated[NotNegative | Tensions, quantity("", "N")] = 0.0
    total_pull: Annotated[NotNegative | None, quantity("maximal sum of the tensions", "N")] = None
    stroke_max_mm: Annotated[
        NotNegative | Tensions | None,
        quantity("maximal length that a winch takes in from its zero", "mm"),
    ] = None
    stroke_min_mm: Annotated[
        Annotated[float, Meta(le=0)] | Tensions | None,
        quantity("minimal stroke, negative for paying out; -stroke_max_mm by default", "mm"),
    ] = None
    stroke_zero: Annotated[
        Literal["straight", "at rest"],
        Meta(description="zero of the winches: the straight arm, or the arm at rest in the scene"),
    ] = "straight"


BaseTable: Any = table(BaseJoints)
TABLES[BaseJoints] = BaseTable


class MotionTable(Table, frozen=True):
    """Rates and times of `octoplan trajectory`."""

    rate_max: Annotated[
        Positive | Tensions | None, quantity("of tensions; one number, or one per tendon", "N/s")
    ] = None
    stroke_rate_max_mm_s: Annotated[Positive | None, quantity("of tendon lengths", "mm/s")] = None
    stroke_acceleration_max_mm_s2: Annotated[
        Positive | None,
        quantity("of tendon lengths; the arm then stops at each waypoint", "mm/s2"),
    ] = None
    tip_acceleration_max_m_s2: Annotated[
        Positive | None, quantity("of the tip; the arm then stops at each waypoint", "m/s2")
    ] = None
    quasi_static: Annotated[
        bool, Meta(description="whether the tip accelerates by at most a tenth of gravity")
    ] = False
    times_s: Annotated[
        list[Positive] | None,
        quantity("of the waypoints; minimises effort in place of time", "s"),
    ] = None


class StiffnessTable(Table, frozen=True):
    """Options of `octoplan stiffness`; see octoplan.model.stiffness."""

    hold: Annotated[
        Hold | None, Meta(description="default: length if the scene has lengths, else tension")
    ] = None
    at_mm: Annotated[
        Positive | None, quantity("arc length of the point; the tip by default", "mm")
    ] = None
    tendon_EA: TendonEA = None
    release: Annotated[
        bool, Meta(description="whether tendons of held length without tension are slack")
    ] = True


class OptionsTable(Table, frozen=True, kw_only=True):
    """Options of settle, stiffness, plan and trajectory; the keys are arguments."""

    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-6
    time_limit_s: Annotated[
        Positive | None,
        quantity("limit of the computing time; returns the best result so far", "s"),
    ] = None
    compile: Annotated[
        bool | Literal["auto"],
        Meta(description="whether to compile plan, settle and stiffness; see settle"),
    ] = False
    norm: Annotated[
        Literal["2", "1", "inf", 1, 2],
        Meta(description="effort: root of the sum of squares, sum, or largest tension"),
    ] = "2"
    stability_margin: Annotated[
        Annotated[float, Meta(ge=0, le=1)] | None,
        Meta(
            description="minimal stability of a plan under loads; by default 0.1 if feasible",
        ),
    ] = None
    clearance_mm: Annotated[
        NotNegative, quantity("minimal distance of the arm's surface from obstacles", "mm")
    ] = 0.0
    self_clearance: Annotated[
        bool,
        Meta(description="whether this distance also holds to the arm itself and its base plane"),
    ] = False
    tendon_EA: TendonEA = None
    tendon_outside_mm: Annotated[
        NotNegative, quantity("length of elastic tendon between winch and base", "mm")
    ] = 0.0


class SceneTable(OptionsTable, frozen=True, kw_only=True):
    """A scene file: an arm, effects, and inputs of the computations."""

    arm: ArmTable
    effects: EffectsTable = EffectsTable()
    target: Annotated[TargetTable | None, Meta(description="the target of plan")] = None
    targets: Annotated[
        tuple[TargetTable, ...], Meta(description="several simultaneous targets of plan")
    ] = ()
    waypoints: Annotated[
        tuple[TargetTable, ...], Meta(description="targets of trajectory, in order")
    ] = ()
    motion: MotionTable = MotionTable()
    obstacles: Annotated[
        tuple[ObstacleTable, ...], Meta(description="obstacles that the whole arm avoids")
    ] = ()
    limits: LimitsTable | None = None
    base: Annotated[
        BaseTable | None,
        Meta(description="joints of the base that plan and trajectory move"),
    ] = None
    tensions: Annotated[
        Tensions | None, quantity("one row per section, tip first, or flat", "N")
    ] = None
    lengths_mm: Annotated[
        Tensions | None,
        quantity(
            "tendon length between base and anchorage, ordered like tensions; nan for tendons "
            "whose tension is given, and tensions are nan for tendons whose length is given",
            "mm",
        ),
    ] = None
    strokes_mm: Annotated[
        Tensions | None,
        quantity("replaces lengths_mm: length taken in from the straight arm", "mm"),
    ] = None
    stiffness: StiffnessTable = StiffnessTable()


def with_defaults(table: SceneTable, folder: Path) -> dict[str, Any]:
    """Return a scene as dicts, lists and values, including all defaults.

    Mesh files, relative to a folder, are replaced by vertices and faces.
    """
    obstacles = tuple(inline_mesh(item, folder) for item in table.obstacles)
    full = structs.replace(table, obstacles=obstacles)
    result: dict[str, Any] = msgspec.msgpack.decode(msgspec.msgpack.encode(full))
    return result


# Files that vary a scene

SceneKey = Annotated[
    str | dict[str, Any], Meta(description="a scene file, relative to this file; or a table")
]
