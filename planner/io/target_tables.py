"""The targets of a scene file, one table each, told apart by their type."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Union

import numpy as np
from msgspec import Meta

import planner.targets
from model.errors import InputError
from planner.io.arm_tables import FRAME
from planner.io.codec import (
    Join,
    NotNegative,
    Positive,
    Table,
    Vector,
    check_all_written,
    quantity,
    value_of,
    written_as,
)
from planner.io.obstacle_tables import ConvexTable
from planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    FetchReach,
    Hold,
    MinimumStiffness,
    Softest,
    Stiffest,
    Target,
    TipPointing,
    TipPose,
    TipPosition,
    Wrap,
)

HoldKey = Annotated[Literal["tension", "length"], Meta(description="what holds the tendons")]
TendonEA = Annotated[Positive | None, quantity("stiffness E A of tendons of held length", "N")]
Direction = Annotated[Vector, Meta(description="in the base frame")]
Place = Annotated[Vector, quantity("in the base frame", "mm")]
BendKey = Annotated[
    tuple[Annotated[float, Meta(ge=0, le=180)], float],
    quantity("[bend, plane of the bend]", "deg"),
]
Weights = Annotated[
    tuple[Positive, Positive],
    Meta(description="[position, orientation]: what counts where not both can be had"),
]


@written_as(BendingPlane)
class BendingPlaneTable(Table, tag="bending-plane", frozen=True):
    """See BendingPlane."""

    angle_deg: Annotated[
        float, quantity("of the plane; T_i2 alone is 0, T_i3 90, T_i4 180, T_i1 -90", "deg")
    ]
    bend_deg: Annotated[float, quantity("", "deg", gt=0, le=180)]
    section: Annotated[int, Meta(ge=1, description="whose tendons pull, 1 at the tip")] = 1


@written_as(TipPosition)
class TipPositionTable(Table, tag="tip-position", frozen=True):
    """See TipPosition."""

    position_mm: Place


@written_as(TipPointing)
class TipPointingTable(Table, tag="tip-pointing", frozen=True):
    """See TipPointing: where the tip is and where it points; how it rolls is free."""

    position_mm: Place
    direction: Annotated[Vector, Meta(description="of the tip's tangent, of any length but 0")]
    weights: Weights = (1.0, 1.0)


@written_as(TipPose, frame=FRAME)
class TipPoseTable(Table, tag="tip-pose", frozen=True):
    """See TipPose; tangent, normal and their cross product are the columns of the frame."""

    position_mm: Place
    tangent: Annotated[Vector, Meta(description="t wanted at the tip, of length 1")]
    normal: Annotated[Vector, Meta(description="n wanted at the tip, of length 1, across t")]
    weights: Weights = (1.0, 1.0)


@written_as(Backbone)
class BackboneTable(Table, tag="backbone", frozen=True):
    """See Backbone."""

    points_mm: Annotated[list[Vector], quantity("base to tip", "mm", min_length=1)]
    s_mm: Annotated[list[Positive] | None, quantity("arc lengths that are to be there", "mm")] = (
        None
    )
    weights: Annotated[list[NotNegative] | None, Meta(description="of the points")] = None


@written_as(Fetch)
class FetchTable(Table, tag="fetch", frozen=True):
    """See Fetch: each stretch with its bend and the plane of that."""

    proximal_deg: BendKey
    medial_deg: BendKey
    distal_deg: BendKey


@written_as(FetchReach)
class FetchReachTable(Table, tag="fetch-reach", frozen=True):
    """See FetchReach."""

    mouth_mm: Place
    bend_deg: Annotated[float, quantity("least bend of each stretch", "deg", ge=0, lt=180)] = 30.0
    plane_deg: Annotated[float | None, quantity("of all anchorages", "deg")] = None


def _stiffness(direction: Vector | None, matrix: Any) -> Any:
    if (direction is None) == (matrix is None):
        given = "neither" if matrix is None else "both"
        raise InputError("minimum-stiffness", given, "a direction, or a matrix")
    return matrix if direction is None else direction


def _stiffness_keys(own: Any) -> dict[str, Any]:
    return {"matrix" if np.ndim(own) == 2 else "direction": np.array(own).tolist()}


@written_as(MinimumStiffness, direction=Join(("direction", "matrix"), _stiffness, _stiffness_keys))
class MinimumStiffnessTable(Table, tag="minimum-stiffness", frozen=True):
    """See MinimumStiffness: against forces along a direction, or as a matrix."""

    value: Annotated[Positive, quantity("along the direction, or of the matrix", "N/m")]
    direction: Annotated[Vector | None, Meta(description="in the base frame")] = None
    matrix: Annotated[
        tuple[Vector, Vector, Vector] | None,
        Meta(description="symmetric and positive definite, in place of a direction"),
    ] = None
    hold: HoldKey = "tension"
    tendon_EA: TendonEA = None


@written_as(Stiffest)
class StiffestTable(Table, tag="stiffest", frozen=True):
    """See Stiffest."""

    direction: Direction
    hold: HoldKey = "tension"
    tendon_EA: TendonEA = None


@written_as(Softest)
class SoftestTable(Table, tag="softest", frozen=True):
    """See Softest."""

    direction: Direction
    hold: HoldKey = "tension"
    tendon_EA: TendonEA = None


@written_as(Wrap)
class WrapTable(Table, tag="wrap", frozen=True):
    """See Wrap: turns, or the length of the part."""

    obstacle: ConvexTable
    turns: Annotated[Positive | None, Meta(description="round the obstacle")] = None
    length_mm: Annotated[Positive | None, quantity("of the part", "mm")] = None
    start_mm: Annotated[
        NotNegative | None, quantity("where the part begins; it ends at the tip without", "mm")
    ] = None
    tolerance: Annotated[Positive, Meta(description="of the gap over the arm's radius")] = 0.25


def _wrench_keys(own: tuple[float, ...]) -> dict[str, Any]:
    return {"force": list(own[:3])} | ({"moment": list(own[3:])} if own[3:] else {})


@written_as(
    Hold,
    wrench=Join(("force", "moment"), lambda force, m: (*force, *(m or ())), _wrench_keys),
)
class HoldTable(Table, tag="hold", frozen=True):
    """See Hold: a force on the object, and a moment about its centre if that is to be held too."""

    obstacle: ConvexTable
    force: Annotated[Vector, quantity("on the object, base frame", "N")]
    moment: Annotated[
        Vector | None, quantity("about its centre; taken up elsewhere without", "N m")
    ] = None
    friction: Annotated[NotNegative, Meta(description="Coulomb's coefficient")] = 0.0


_TABLES = tuple(
    own
    for own in list(globals().values())
    if isinstance(own, type) and issubclass(own, Table) and own.__module__ == __name__
)
TargetTable: Any = Union[_TABLES]  # noqa: UP007  (of all tables above)


def target_of(table: Any) -> Target:
    """Return the target of a table; raises InputError that names a key, or a target's field."""
    target: Target = value_of(table)
    return target


# What a target is made of, or states itself with, is no target.
_PARTS = {Target, Bend, planner.targets.Terms, planner.targets.View}
_PUBLIC = (getattr(planner.targets, name) for name in planner.targets.__all__)
check_all_written([own for own in _PUBLIC if own not in _PARTS], "targets")
