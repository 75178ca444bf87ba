"""The tables of a scene file, key by key; the keys name their units where these are not SI."""

from __future__ import annotations

import msgspec


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a scene file; keys that it does not know are refused."""


class SamplesTable(Table, frozen=True):
    """A function of arc length by samples."""

    s_mm: list[float]
    values_mm: list[float]


PathKey = list[float] | SamplesTable


class SectionTable(Table, frozen=True):
    """An anchorage section."""

    at_mm: float
    offset_mm: PathKey
    angles_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)


class ArmTable(Table, frozen=True):
    """An arm: `preset` alone, or length, radius and sections."""

    preset: str | None = None
    length_mm: float | None = None
    radius_mm: PathKey | None = None
    sections: list[SectionTable] = []
    E_kPa: float = 110.0
    nu: float = 0.5
    density: float = 1080.0


class ShearTable(Table, frozen=True):
    """See Shear."""

    k_s: float = 1.0


class WeightTable(Table, frozen=True):
    """See Weight."""

    g: tuple[float, ...] = (0.0, 0.0, -9.81)


class BuoyancyTable(Table, frozen=True):
    """See Buoyancy."""

    density: float = 1000.0


class TipLoadTable(Table, frozen=True):
    """See TipLoad."""

    force: tuple[float, ...] = (0.0, 0.0, 0.0)
    moment: tuple[float, ...] = (0.0, 0.0, 0.0)
    follower: bool = False


class PointLoadTable(Table, frozen=True):
    """See PointLoad."""

    s_mm: float
    force: tuple[float, ...]


class CurrentTable(Table, frozen=True):
    """See Current."""

    velocity: tuple[float, ...]
    density: float = 1000.0
    coefficient: float = 1.1


class FrictionTable(Table, frozen=True):
    """See Friction."""

    mu: float
    direction: int | tuple[int, ...] = 1


class EffectsTable(Table, frozen=True):
    """The effects called for."""

    extension: bool = False
    exact_tendons: bool = False
    neo_hookean: bool = False
    anticlastic: bool = False
    as_printed: bool = False
    shear: ShearTable | None = None
    weight: WeightTable | None = None
    buoyancy: BuoyancyTable | None = None
    tip_load: TipLoadTable | None = None
    point_loads: list[PointLoadTable] = []
    current: CurrentTable | None = None
    friction: FrictionTable | None = None


class BendingPlaneTable(Table, tag="bending-plane", frozen=True):
    """See BendingPlane."""

    angle_deg: float
    bend_deg: float
    section: int = 1


class TipPositionTable(Table, tag="tip-position", frozen=True):
    """See TipPosition."""

    position_mm: list[float]


class TipPoseTable(Table, tag="tip-pose", frozen=True):
    """See TipPose; tangent, normal and binormal are the columns of the frame."""

    position_mm: list[float]
    tangent: list[float]
    normal: list[float]


class BackboneTable(Table, tag="backbone", frozen=True):
    """See Backbone."""

    points_mm: list[list[float]]
    s_mm: list[float] | None = None
    weights: list[float] | None = None


class FetchTable(Table, tag="fetch", frozen=True):
    """See Fetch: (bend, plane) of each stretch."""

    proximal_deg: list[float]
    medial_deg: list[float]
    distal_deg: list[float]


class FetchReachTable(Table, tag="fetch-reach", frozen=True):
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


class LimitsTable(Table, frozen=True):
    """Limits of the tensions [N]."""

    tension_max: float | list[list[float] | float]
    tension_min: float | list[list[float] | float] = 0.0
    total_pull: float | None = None


class SceneTable(Table, frozen=True):
    """A whole scene file."""

    arm: ArmTable
    effects: EffectsTable = EffectsTable()
    target: TargetTable | None = None
    targets: list[TargetTable] = []
    limits: LimitsTable | None = None
    tensions: list[list[float] | float] | None = None
    accuracy: float = 1e-6
    norm: str = "2"
    form: str | None = None
