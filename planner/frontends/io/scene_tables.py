"""The tables of a scene file: its effects, what is asked, and how.

Effects are a key each, which is a switch, a table or several.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
from msgspec import Meta, structs

import octoplan.model.effects
import octoplan.model.extensions.contact
import octoplan.model.extensions.printed
from octoplan.model.effects import Effect
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.quantities import NotNegative, Positive
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
    inlined,
    public,
)
from octoplan.planner.frontends.io.tables import (
    TABLES,
    Accuracy,
    Tensions,
    attributes_told,
    sentence,
    struct,
    table,
)

# Keys that enable several effects at once.
BUNDLES = {"silicone": Scene.silicone(), "as_printed": Scene.as_printed()}
_SILICONE = "what a real silicone arm calls for: extension, exact_tendons and neo_hookean"
_EFFECTS: list[type[Effect]] = sorted(
    (
        kind
        for module in (
            octoplan.model.effects,
            octoplan.model.extensions.contact,
            octoplan.model.extensions.printed,
        )
        for kind in public(module)
        if kind is not Effect
    ),
    key=lambda kind: kind.__name__,
)
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


Hold = Literal["tension", "length"]
TendonEA = Annotated[Positive | None, quantity("stiffness E A of tendons of held length", "N")]


class LimitsTable(Table, frozen=True):
    """Limits of tensions [N] and strokes [mm]: a number for all tendons, or one for each."""

    tension_max: Annotated[NotNegative | Tensions, quantity("", "N")]
    tension_min: Annotated[NotNegative | Tensions, quantity("", "N")] = 0.0
    total_pull: Annotated[
        NotNegative | None, quantity("the most that all together may pull", "N")
    ] = None
    stroke_max_mm: Annotated[
        NotNegative | Tensions | None,
        quantity("the most that winches take in from where they are zeroed", "mm"),
    ] = None
    stroke_min_mm: Annotated[
        Annotated[float, Meta(le=0)] | Tensions | None,
        quantity("the least, 0 or below: paid out; as much as taken in unless given", "mm"),
    ] = None
    stroke_zero: Annotated[
        Literal["straight", "at rest"],
        Meta(description="where winches are zeroed: the arm straight, or at rest in the scene"),
    ] = "straight"


class MotionTable(Table, frozen=True):
    """How fast `octoplan trajectory` may go, and when it is to be at each waypoint."""

    rate_max: Annotated[
        Positive | Tensions | None, quantity("of tensions, or one for each", "N/s")
    ] = None
    stroke_rate_max_mm_s: Annotated[
        Positive | None, quantity("of the lengths of tendons", "mm/s")
    ] = None
    stroke_acceleration_max_mm_s2: Annotated[
        Positive | None,
        quantity("of these rates; then the arm rests at each waypoint", "mm/s2"),
    ] = None
    tip_acceleration_max_m_s2: Annotated[
        Positive | None, quantity("of the tip; then the arm rests at each waypoint", "m/s2")
    ] = None
    quasi_static: Annotated[
        bool, Meta(description="whether the tip accelerates by a tenth of gravity at most")
    ] = False
    times_s: Annotated[
        list[Positive] | None,
        quantity("of each waypoint; then effort is made least, otherwise time", "s"),
    ] = None


class StiffnessTable(Table, frozen=True):
    """What `octoplan stiffness` is to tell; see octoplan.model.stiffness."""

    hold: Annotated[
        Hold | None, Meta(description="tension unless given, length where the scene has lengths")
    ] = None
    at_mm: Annotated[
        Positive | None, quantity("arc length of the point; the tip unless given", "mm")
    ] = None
    tendon_EA: TendonEA = None
    release: Annotated[
        bool, Meta(description="whether tendons without tension are slack where lengths are held")
    ] = True


class OptionsTable(Table, frozen=True, kw_only=True):
    """Options of what is asked, which settle, stiffness, plan and trajectory have as arguments."""

    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-6
    time_limit_s: Annotated[
        Positive | None,
        quantity("stop then, with the best that was found by then; none unless given", "s"),
    ] = None
    compile: Annotated[
        bool | Literal["auto"],
        Meta(description="whether to plan, settle and find stiffness by machine code; see settle"),
    ] = False
    norm: Annotated[
        Literal["2", "1", "inf", 1, 2],
        Meta(description="effort: root of the sum of squares, sum, or largest tension"),
    ] = "2"
    stability_margin: Annotated[
        Annotated[float, Meta(ge=0, le=1)] | None,
        Meta(
            description="the least stability under loads that a plan may have; "
            "0.1 where that can be had unless given"
        ),
    ] = None
    clearance_mm: Annotated[
        NotNegative, quantity("least distance of the arm's surface from obstacles", "mm")
    ] = 0.0
    self_clearance: Annotated[
        bool,
        Meta(description="whether it stays as far from itself and from behind its base plane"),
    ] = False
    tendon_EA: TendonEA = None
    tendon_outside_mm: Annotated[
        NotNegative, quantity("tendon between winch and base, which stretches too", "mm")
    ] = 0.0


class SceneTable(OptionsTable, frozen=True, kw_only=True):
    """A scene file: an arm, the effects enabled, and what is asked."""

    arm: ArmTable
    effects: EffectsTable = EffectsTable()
    target: Annotated[TargetTable | None, Meta(description="what plan is to reach")] = None
    targets: Annotated[
        tuple[TargetTable, ...], Meta(description="what plan is to reach, all together")
    ] = ()
    waypoints: Annotated[
        tuple[TargetTable, ...], Meta(description="what trajectory is to reach, in order")
    ] = ()
    motion: MotionTable = MotionTable()
    obstacles: Annotated[
        tuple[ObstacleTable, ...], Meta(description="what the arm keeps clear of, all along")
    ] = ()
    limits: LimitsTable | None = None
    tensions: Annotated[Tensions | None, quantity("a row a section, tip first, or flat", "N")] = (
        None
    )
    lengths_mm: Annotated[
        Tensions | None,
        quantity(
            "what winches leave of tendons between base and anchorage, like tensions; nan where a "
            "tension is given, which is nan where a length is",
            "mm",
        ),
    ] = None
    strokes_mm: Annotated[
        Tensions | None,
        quantity("in place of lengths_mm: what is taken in from the straight arm", "mm"),
    ] = None
    stiffness: StiffnessTable = StiffnessTable()


def whole(table: SceneTable, folder: Path) -> dict[str, Any]:
    """Return a scene as dicts, lists and values, with all that it has by default.

    Files of meshes, looked for from a folder, are numbers in it.
    """
    obstacles = tuple(inlined(item, folder) for item in table.obstacles)
    full = structs.replace(table, obstacles=obstacles)
    result: dict[str, Any] = msgspec.msgpack.decode(msgspec.msgpack.encode(full))
    return result


# Files that name a scene, and say what of it varies.

SceneKey = Annotated[
    str | dict[str, Any], Meta(description="a scene file, from this file's folder; or a table")
]
