"""The targets of a scene file, one table each, told apart by their type."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from model import InputError
from planner.scenes.keys import (
    MM,
    NotNegative,
    Positive,
    Table,
    Vector,
    frame,
    metres,
    radians,
)
from planner.scenes.obstacles import ObstacleTable, obstacle_of
from planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    MinimumStiffness,
    Softest,
    Stiffest,
    Target,
    TipPointing,
    TipPose,
    TipPosition,
    Wrap,
)
from planner.targets import Hold as HoldObject

Hold = Annotated[Literal["tension", "length"], Meta(description="what holds the tendons")]
TendonEA = Annotated[
    Positive | None, Meta(description="stiffness E A of tendons of held length [N]")
]
Direction = Annotated[Vector, Meta(description="in the base frame")]
BendKey = Annotated[
    tuple[Annotated[float, Meta(ge=0, le=180)], float],
    Meta(description="[bend, plane of the bend] [deg]"),
]

Weights = Annotated[
    tuple[Positive, Positive],
    Meta(description="[position, orientation]: what counts where not both can be had"),
]


class BendingPlaneTable(Table, tag="bending-plane", frozen=True):
    """See BendingPlane."""

    angle_deg: Annotated[
        float, Meta(description="of the plane [deg]; T_i2 alone is 0, T_i3 90, T_i4 180, T_i1 -90")
    ]
    bend_deg: Annotated[float, Meta(gt=0, le=180, description="[deg]")]
    section: Annotated[int, Meta(ge=1, description="whose tendons pull, 1 at the tip")] = 1


class TipPositionTable(Table, tag="tip-position", frozen=True):
    """See TipPosition."""

    position_mm: Annotated[Vector, Meta(description="in the base frame [mm]")]


class TipPointingTable(Table, tag="tip-pointing", frozen=True):
    """See TipPointing: where the tip is and where it points; how it rolls is free."""

    position_mm: Annotated[Vector, Meta(description="in the base frame [mm]")]
    direction: Annotated[Vector, Meta(description="of the tip's tangent, of any length but 0")]
    weights: Weights = (1.0, 1.0)


class TipPoseTable(Table, tag="tip-pose", frozen=True):
    """See TipPose; tangent, normal and their cross product are the columns of the frame."""

    position_mm: Annotated[Vector, Meta(description="in the base frame [mm]")]
    tangent: Annotated[Vector, Meta(description="t wanted at the tip, of length 1")]
    normal: Annotated[Vector, Meta(description="n wanted at the tip, of length 1, across t")]
    weights: Weights = (1.0, 1.0)


class BackboneTable(Table, tag="backbone", frozen=True):
    """See Backbone."""

    points_mm: Annotated[list[Vector], Meta(min_length=1, description="base to tip [mm]")]
    s_mm: Annotated[
        list[Positive] | None, Meta(description="arc lengths that are to be there [mm]")
    ] = None
    weights: Annotated[list[NotNegative] | None, Meta(description="of the points")] = None


class FetchTable(Table, tag="fetch", frozen=True):
    """See Fetch: each stretch with its bend and the plane of that."""

    proximal_deg: BendKey
    medial_deg: BendKey
    distal_deg: BendKey


class FetchReachTable(Table, tag="fetch-reach", frozen=True):
    """See FetchReach."""

    mouth_mm: Annotated[Vector, Meta(description="in the base frame [mm]")]
    bend_deg: Annotated[
        float, Meta(ge=0, lt=180, description="least bend of each stretch [deg]")
    ] = 30.0
    plane_deg: Annotated[float | None, Meta(description="of all anchorages [deg]")] = None


class MinimumStiffnessTable(Table, tag="minimum-stiffness", frozen=True):
    """See MinimumStiffness: against forces along a direction, or as a matrix."""

    value: Annotated[Positive, Meta(description="along the direction [N/m], or of the matrix")]
    direction: Annotated[Vector | None, Meta(description="in the base frame")] = None
    matrix: Annotated[
        tuple[Vector, Vector, Vector] | None,
        Meta(description="symmetric and positive definite, in place of a direction"),
    ] = None
    hold: Hold = "tension"
    tendon_EA: TendonEA = None


class StiffestTable(Table, tag="stiffest", frozen=True):
    """See Stiffest."""

    direction: Direction
    hold: Hold = "tension"
    tendon_EA: TendonEA = None


class SoftestTable(Table, tag="softest", frozen=True):
    """See Softest."""

    direction: Direction
    hold: Hold = "tension"
    tendon_EA: TendonEA = None


class WrapTable(Table, tag="wrap", frozen=True):
    """See Wrap: turns, or the length of the part."""

    obstacle: ObstacleTable
    turns: Annotated[Positive | None, Meta(description="round the obstacle")] = None
    length_mm: Annotated[Positive | None, Meta(description="of the part [mm]")] = None
    start_mm: Annotated[
        NotNegative | None, Meta(description="where the part begins [mm]; ends at the tip without")
    ] = None
    tolerance: Annotated[Positive, Meta(description="of the gap over the arm's radius")] = 0.25


class HoldTable(Table, tag="hold", frozen=True):
    """See Hold: a force on the object, and a moment about its centre if that is to be held too."""

    obstacle: ObstacleTable
    force: Annotated[Vector, Meta(description="on the object, base frame [N]")]
    moment: Annotated[
        Vector | None, Meta(description="about its centre [N m]; taken up elsewhere without")
    ] = None
    friction: Annotated[NotNegative, Meta(description="Coulomb's coefficient")] = 0.0


TargetTable = (
    BendingPlaneTable
    | TipPositionTable
    | TipPointingTable
    | TipPoseTable
    | BackboneTable
    | FetchTable
    | FetchReachTable
    | MinimumStiffnessTable
    | StiffestTable
    | SoftestTable
    | WrapTable
    | HoldTable
)


def target_of(table: TargetTable) -> Target:
    """Return the target of a table; raises InputError that names a key, or a target's field."""
    match table:
        case BendingPlaneTable():
            return BendingPlane(radians(table.angle_deg), radians(table.bend_deg), table.section)
        case TipPositionTable():
            return TipPosition(metres(table.position_mm))
        case TipPoseTable():
            wanted = frame(table.tangent, table.normal)
            return TipPose(metres(table.position_mm), wanted, table.weights)
        case TipPointingTable():
            return TipPointing(metres(table.position_mm), table.direction, table.weights)
        case BackboneTable():
            s = None if table.s_mm is None else metres(table.s_mm)
            weights = None if table.weights is None else tuple(table.weights)
            return Backbone(tuple(map(metres, table.points_mm)), s, weights)
        case FetchTable():
            bends = (table.proximal_deg, table.medial_deg, table.distal_deg)
            return Fetch(*(Bend(radians(bend), radians(plane)) for bend, plane in bends))
        case FetchReachTable():
            plane = None if table.plane_deg is None else radians(table.plane_deg)
            return Fetch.reach(metres(table.mouth_mm), radians(table.bend_deg), plane)
        case MinimumStiffnessTable():
            return _minimum(table)
        case StiffestTable() | SoftestTable():
            kind = Stiffest if isinstance(table, StiffestTable) else Softest
            return kind(table.direction, hold=table.hold, tendon_EA=table.tendon_EA)
        case WrapTable():
            obstacle = obstacle_of(table.obstacle)
            lengths = (_metres(table.length_mm), _metres(table.start_mm))
            return Wrap(obstacle, table.turns, *lengths, table.tolerance)
        case HoldTable():
            wrench = (*table.force, *(table.moment or ()))
            return HoldObject(obstacle_of(table.obstacle), wrench, table.friction)


def _metres(value: float | None) -> float | None:
    return None if value is None else value * MM


def _minimum(table: MinimumStiffnessTable) -> MinimumStiffness:
    if (table.direction is None) == (table.matrix is None):
        given = "neither" if table.matrix is None else "both"
        raise InputError("minimum-stiffness", given, "a direction, or a matrix")
    wanted = table.matrix if table.direction is None else table.direction
    return MinimumStiffness(wanted, table.value, table.hold, table.tendon_EA)
