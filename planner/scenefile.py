"""Scene files: TOML, checked key by key. The keys name their units where these are not SI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import Anchorage, Arm, InputError, Linear, Material, Sampled, Scene
from model.effects import Effect, ExactTendons, Extension, NeoHookean, PrintedStatics
from planner.targets import Backbone, Bend, BendingPlane, Fetch, Target, TipPose, TipPosition

_MM = 1e-3
R = TypeVar("R")


class _Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a scene file; keys that it does not know are refused."""


class SamplesTable(_Table, frozen=True):
    """A function of arc length by samples."""

    s_mm: list[float]
    values_mm: list[float]


PathKey = list[float] | SamplesTable


class SectionTable(_Table, frozen=True):
    """An anchorage section."""

    at_mm: float
    offset_mm: PathKey
    angles_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)


class ArmTable(_Table, frozen=True):
    """An arm: `preset` alone, or length, radius and sections."""

    preset: str | None = None
    length_mm: float | None = None
    radius_mm: PathKey | None = None
    sections: list[SectionTable] = []
    E_kPa: float = 110.0
    nu: float = 0.5
    density: float = 1080.0


class EffectsTable(_Table, frozen=True):
    """The effects called for."""

    extension: bool = False
    exact_tendons: bool = False
    neo_hookean: bool = False
    anticlastic: bool = False
    as_printed: bool = False


class BendingPlaneTable(_Table, tag="bending-plane", frozen=True):
    """See BendingPlane."""

    angle_deg: float
    bend_deg: float
    section: int = 1


class TipPositionTable(_Table, tag="tip-position", frozen=True):
    """See TipPosition."""

    position_mm: list[float]


class TipPoseTable(_Table, tag="tip-pose", frozen=True):
    """See TipPose; tangent, normal and binormal are the columns of the frame."""

    position_mm: list[float]
    tangent: list[float]
    normal: list[float]


class BackboneTable(_Table, tag="backbone", frozen=True):
    """See Backbone."""

    points_mm: list[list[float]]
    s_mm: list[float] | None = None
    weights: list[float] | None = None


class FetchTable(_Table, tag="fetch", frozen=True):
    """See Fetch: (bend, plane) of each stretch."""

    proximal_deg: list[float]
    medial_deg: list[float]
    distal_deg: list[float]


class FetchReachTable(_Table, tag="fetch-reach", frozen=True):
    """See FetchReach."""

    mouth_mm: list[float]
    bend_deg: float = 30.0
    plane_deg: float | None = None


TargetTable = (
    BendingPlaneTable
    | TipPositionTable
    | TipPoseTable
    | BackboneTable
    | FetchTable
    | FetchReachTable
)


class LimitsTable(_Table, frozen=True):
    """Limits of the tensions [N]."""

    tension_max: float | list[list[float] | float]
    tension_min: float | list[list[float] | float] = 0.0
    total_pull: float | None = None


class SceneTable(_Table, frozen=True):
    """A whole scene file."""

    arm: ArmTable
    effects: EffectsTable = EffectsTable()
    target: TargetTable | None = None
    targets: list[TargetTable] = []
    limits: LimitsTable | None = None
    tensions: list[list[float] | float] | None = None
    accuracy: float = 1e-6
    norm: str = "2"
    form: str = "condensed"


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
    return Scene(*(effect for wanted, effect in called if wanted))


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
