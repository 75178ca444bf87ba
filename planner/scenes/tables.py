"""A whole scene file, table by table; the keys name their units where these are not SI."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from planner.scenes.arm import ArmTable
from planner.scenes.effects import EffectsTable
from planner.scenes.keys import Accuracy, NotNegative, Positive, Table, Tensions
from planner.scenes.obstacles import ObstacleTable
from planner.scenes.targets import Hold, TargetTable, TendonEA


class LimitsTable(Table, frozen=True):
    """Limits of tensions [N] and strokes [mm]: a number for all tendons, or one for each."""

    tension_max: Annotated[NotNegative | Tensions, Meta(description="[N]")]
    tension_min: Annotated[NotNegative | Tensions, Meta(description="[N]")] = 0.0
    total_pull: Annotated[
        NotNegative | None, Meta(description="the most that all together may pull [N]")
    ] = None
    stroke_max_mm: Annotated[
        NotNegative | Tensions | None,
        Meta(description="the most that winches take in from the straight arm at rest [mm]"),
    ] = None
    stroke_min_mm: Annotated[
        Annotated[float, Meta(le=0)] | Tensions | None,
        Meta(description="the least, 0 or below: paid out; as much as taken in unless given [mm]"),
    ] = None
    stroke_zero: Annotated[
        Literal["straight", "at rest"],
        Meta(description="where winches are zeroed: the arm straight, or at rest in the scene"),
    ] = "straight"


class MotionTable(Table, frozen=True):
    """How fast `octoplan trajectory` may go, and when it is to be at each waypoint."""

    rate_max: Annotated[
        Positive | Tensions | None, Meta(description="of tensions [N/s], or one for each")
    ] = None
    stroke_rate_max_mm_s: Annotated[
        Positive | None, Meta(description="of the lengths of tendons [mm/s]")
    ] = None
    stroke_acceleration_max_mm_s2: Annotated[
        Positive | None,
        Meta(description="of these rates [mm/s2]; then the arm rests at each waypoint"),
    ] = None
    times_s: Annotated[
        list[Positive] | None,
        Meta(description="of each waypoint [s]; then effort is made least, otherwise time"),
    ] = None


class StiffnessTable(Table, frozen=True):
    """What `octoplan stiffness` is to tell; see model.stiffness."""

    hold: Annotated[
        Hold | None, Meta(description="tension unless given, length where the scene has lengths")
    ] = None
    at_mm: Annotated[
        Positive | None, Meta(description="arc length of the point [mm]; the tip unless given")
    ] = None
    tendon_EA: TendonEA = None
    release: Annotated[
        bool, Meta(description="whether tendons without tension are slack where lengths are held")
    ] = True


class SceneTable(Table, frozen=True):
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
    clearance_mm: Annotated[
        NotNegative, Meta(description="least distance of the arm's surface from obstacles [mm]")
    ] = 0.0
    self_clearance: Annotated[
        bool,
        Meta(description="whether it stays as far from itself and from behind its base plane"),
    ] = False
    limits: LimitsTable | None = None
    tensions: Annotated[
        Tensions | None, Meta(description="[N], a row a section, tip first, or flat")
    ] = None
    lengths_mm: Annotated[
        Tensions | None,
        Meta(
            description="what winches leave of tendons between base and anchorage [mm], like "
            "tensions; nan where a tension is given, which is nan where a length is"
        ),
    ] = None
    strokes_mm: Annotated[
        Tensions | None,
        Meta(description="in place of lengths_mm: what is taken in from the straight arm [mm]"),
    ] = None
    tendon_EA: TendonEA = None
    tendon_outside_mm: Annotated[
        NotNegative, Meta(description="tendon between winch and base, which stretches too [mm]")
    ] = 0.0
    stiffness: StiffnessTable = StiffnessTable()
    accuracy: Annotated[Accuracy, Meta(description="tip error over arm length")] = 1e-6
    time_limit_s: Annotated[
        Positive | None,
        Meta(description="stop then, with the best that was found by then [s]; none unless given"),
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
    solver: Annotated[
        Literal["auto", "ipopt", "fatrop"], Meta(description="what solves the program")
    ] = "auto"
    form: Annotated[
        Literal["condensed", "multiple-shooting"] | None,
        Meta(description="deprecated, has no effect: there is one program"),
    ] = None
