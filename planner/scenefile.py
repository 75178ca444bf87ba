"""Scene files: TOML, checked key by key. The keys name their units where these are not SI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import Anchorage, Arm, InputError, Linear, Material, Sampled, Scene
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
from model.loads import check_loads
from planner.scene_tables import (
    ArmTable,
    BackboneTable,
    BendingPlaneTable,
    EffectsTable,
    FetchTable,
    PathKey,
    SamplesTable,
    SceneTable,
    TargetTable,
    TipPoseTable,
    TipPositionTable,
)
from planner.targets import Backbone, Bend, BendingPlane, Fetch, Target, TipPose, TipPosition

_MM = 1e-3
R = TypeVar("R")


@dataclass(frozen=True)
class Question:
    """What a scene file asks: an arm and a scene, and what to find or to settle."""

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    tensions: Any
    accuracy: float
    options: dict[str, Any]


def load(path: Path) -> Question:
    """Return the question of a scene file.

    Raises InputError that begins with the file's name and the key's path.
    """
    try:
        return read(path.read_bytes(), str(path))
    except OSError as reason:
        raise InputError(str(path), reason.strerror, "a scene file that can be read") from None


def read(text: bytes, name: str = "scene") -> Question:
    """Return the question of a scene file's text; see load."""
    try:
        table = msgspec.toml.decode(text, type=SceneTable)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as reason:
        raise InputError(name, str(reason), "TOML with the keys of a scene file") from None
    tables = [*([table.target] if table.target else []), *table.targets]
    arm = _within(name, "arm", _arm, table.arm)
    scene = _within(name, "effects", _scene, table.effects)
    _within(name, "effects", lambda _: check_loads(arm, scene), None)
    targets = tuple(_within(name, f"target {i + 1}", _target, t) for i, t in enumerate(tables))
    options: dict[str, Any] = {"norm": table.norm, "form": table.form}
    if table.limits is not None:
        options |= msgspec.structs.asdict(table.limits)
    return Question(arm, scene, targets, table.tensions, table.accuracy, options)


def _within(name: str, key: str, build: Callable[[Any], R], table: Any) -> R:
    """Return what is built from a table; an error is told with the file and the table's key."""
    try:
        return build(table)
    except InputError as reason:
        raise InputError(f"{name}, [{key}] {reason.field}", reason.given, reason.allowed) from None


def _arm(table: ArmTable) -> Arm:
    own = (table.length_mm, table.radius_mm, table.sections)
    if table.preset is not None:
        if any(own):
            raise InputError("preset", table.preset, "either a preset or an arm of your own")
        return Arm.from_paper(table.preset)
    if table.length_mm is None or table.radius_mm is None:
        raise InputError("arm", "no shape", "preset, or length_mm, radius_mm and sections")
    sections = tuple(
        Anchorage(
            section.at_mm * _MM,
            _path("offset_mm", section.offset_mm),
            tuple(np.radians(section.angles_deg).tolist()),
        )
        for section in table.sections
    )
    material = Material(table.E_kPa * 1e3, table.nu, table.density)
    return Arm(table.length_mm * _MM, _path("radius_mm", table.radius_mm), sections, material)


def _path(key: str, value: PathKey) -> Linear | Sampled:
    if isinstance(value, SamplesTable):
        s, values = np.array(value.s_mm) * _MM, np.array(value.values_mm) * _MM
        return Sampled(tuple(s.tolist()), tuple(values.tolist()))
    if len(value) != 2:
        raise InputError(key, value, "[base, end] or { s_mm = [...], values_mm = [...] }")
    return Linear(value[0] * _MM, value[1] * _MM)


def _scene(table: EffectsTable) -> Scene:
    if table.anticlastic and not table.neo_hookean:
        raise InputError("anticlastic", True, "anticlastic = true with neo_hookean = true only")
    called: list[tuple[bool, Effect]] = [
        (table.extension or table.as_printed, Extension()),
        (table.exact_tendons, ExactTendons()),
        (table.neo_hookean, NeoHookean(table.anticlastic)),
        (table.as_printed, PrintedStatics()),
    ]
    return Scene(*(effect for wanted, effect in called if wanted), *_loads(table))


def _loads(table: EffectsTable) -> list[Effect]:
    """Return the effects that have tables of their own."""
    kinds = {
        "shear": Shear,
        "weight": Weight,
        "buoyancy": Buoyancy,
        "tip_load": TipLoad,
        "current": Current,
        "friction": Friction,
    }
    tables = [(kind, getattr(table, key)) for key, kind in kinds.items()]
    loads = [kind(**msgspec.structs.asdict(own)) for kind, own in tables if own is not None]
    return [*loads, *(PointLoad(own.s_mm * _MM, own.force) for own in table.point_loads)]


def _target(table: TargetTable) -> Target:
    if isinstance(table, BendingPlaneTable):
        angles = np.radians([table.angle_deg, table.bend_deg])
        return BendingPlane(float(angles[0]), float(angles[1]), table.section)
    if isinstance(table, TipPositionTable):
        return TipPosition(_mm(table.position_mm))
    if isinstance(table, TipPoseTable):
        frame = np.column_stack(
            [table.tangent, table.normal, np.cross(table.tangent, table.normal)]
        )
        return TipPose(_mm(table.position_mm), tuple(tuple(row) for row in frame.tolist()))
    if isinstance(table, BackboneTable):
        s = None if table.s_mm is None else _mm(table.s_mm)
        weights = None if table.weights is None else tuple(table.weights)
        return Backbone(tuple(_mm(point) for point in table.points_mm), s, weights)
    if isinstance(table, FetchTable):
        bends = (table.proximal_deg, table.medial_deg, table.distal_deg)
        return Fetch(*(_bend(bend) for bend in bends))
    plane = None if table.plane_deg is None else float(np.radians(table.plane_deg))
    return Fetch.reach(_mm(table.mouth_mm), float(np.radians(table.bend_deg)), plane)


def _bend(values: list[float]) -> Bend:
    if len(values) != 2:
        raise InputError("bend", values, "[bend, plane] in degrees")
    return Bend(*np.radians(values).tolist())


def _mm(values: list[float]) -> tuple[float, ...]:
    return tuple((np.array(values, dtype=float) * _MM).tolist())
