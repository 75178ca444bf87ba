"""Results as records: what is written to files and told to machines, with a schema each.

SI units, angles in rad; keys name the unit of numbers that have one. Keys are added, never renamed
or removed, while the number at the end of `schema` stays. A key is an attribute of the result, but
for the unit at its end; what is not, is handed over by name.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar, get_args, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from model.effects import PrintedStatics
from model.errors import OctoplanError
from model.time_limit import OutOfTime
from planner.effect_ablation import ProblemSize
from planner.io.annotations import arguments
from planner.io.files import versions
from planner.tendon_lengths import length_error, strokes

POINTS, _SECTIONS = 101, 21
_UNITS = ("_m_per_N", "_N_m2", "_m", "_N", "_s")

Rows = Annotated[Any, Meta(description="a row a section, tip first, or flat")]
Floats = list[float]
Matrix = list[list[float]]
Schema = Meta(description="what this is")
R = TypeVar("R", bound="Record")


class Record(msgspec.Struct, kw_only=True):
    """What a command found."""

    versions: Annotated[dict[str, str], Meta(description="of what computed it")]


def record_of(kind: type[R], of: Any, **others: Any) -> R:
    """Return the record of a result, whose attributes its keys name; others by name."""
    (schema,) = get_args(get_type_hints(kind)["schema"])
    result = {"schema": schema, "versions": versions()}
    for key in kind.__struct_fields__:
        if key in others:
            result[key] = others[key]
        elif key not in ("schema", "versions"):
            result[key] = getattr(of, _attribute(of, key))
    return kind(**result)


def _attribute(of: Any, key: str) -> str:
    if hasattr(of, key):
        return key
    return next(
        key.removesuffix(unit)
        for unit in _UNITS
        if key.endswith(unit) and hasattr(of, key.removesuffix(unit))
    )


# Shapes, stiffness, motions, effects, exports, sweeps


class ShapeRecord(Record, kw_only=True):
    """A settled shape."""

    schema: Annotated[Literal["octoplan shape 1"], Schema]
    tip_m: Floats
    tip_frame: Annotated[Matrix, Meta(description="columns t, n, b")]
    tensions_N: Rows
    error: Annotated[float, Meta(description="estimated tip error over arm length")]
    tendon_lengths_m: Annotated[Floats, Meta(description="in tendon order")]
    strokes_m: Annotated[Floats, Meta(description="taken in from the straight arm at rest")]
    slack: Annotated[list[bool], Meta(description="in tendon order")]
    s_m: Annotated[Floats, Meta(description="arc lengths from the base")]
    position_m: Annotated[Matrix, Meta(description="at s_m")]
    strain: Annotated[Matrix, Meta(description="tau, xi, k [1/m] and q [-] at s_m")]


def shape_record(shape: Any) -> ShapeRecord:
    """Return the record of a settled shape."""
    s = np.linspace(0.0, shape.arm.length, POINTS)
    along = {"s_m": s, "position_m": shape.position(s), "strain": shape.strain(s)}
    held = {
        "tensions_N": shape.arm.by_section(shape.tensions),
        "strokes_m": strokes(shape),
        "slack": shape.slack.ravel(),
    }
    return record_of(ShapeRecord, shape, **along, **held)


def of_shape(plan: Any) -> dict[str, Any]:
    """Return what depends on a plan's shape: None where the tensions do not settle.

    Lengths are None where there are none: as printed.
    """
    keys = ("tip_m", "tip_frame", "slack", "lengths_m", "strokes_m", "tip_error_per_length")
    result: dict[str, Any] = dict.fromkeys(keys)
    try:
        shape = plan.shape
        result |= {"tip_m": shape.tip, "tip_frame": shape.tip_frame, "slack": shape.slack}
        if not plan.scene.has(PrintedStatics):
            error = length_error(shape)
            per_length = dict(zip(error.names, error.each.tolist(), strict=True))
            lengths = {"lengths_m": plan.lengths, "strokes_m": plan.strokes}
            result |= {**lengths, "tip_error_per_length": per_length}
    except (OctoplanError, OutOfTime):
        pass
    return result


class StiffnessRecord(Record, kw_only=True):
    """The compliance of a settled shape at a point, and the stiffness of its sections."""

    schema: Annotated[Literal["octoplan stiffness 1"], Schema]
    tensions_N: Rows
    tendon_lengths_m: Annotated[Floats, Meta(description="in tendon order")]
    tip_m: Floats
    hold: Annotated[Literal["tension", "length"], Meta(description="what holds the tendons")]
    at_m: Annotated[float, Meta(description="arc length of the point")]
    position_m: Annotated[Floats, Meta(description="of the point, base frame")]
    compliance: Annotated[
        Matrix,
        Meta(description="[displacement m; rotation rad] per [force N; moment N m], base frame"),
    ]
    half_axes_m_per_N: Annotated[Floats, Meta(description="of displacements, softest first")]
    directions: Annotated[Matrix, Meta(description="of the half axes, as columns")]
    tension_response: Annotated[Matrix, Meta(description="of each tendon per force and moment")]
    locked: Annotated[list[str], Meta(description="tendons whose length is held")]
    slack: Annotated[list[str], Meta(description="tendons without tension")]
    stable: Annotated[bool, Meta(description="at held tensions")]
    error: Annotated[float, Meta(description="estimated relative error of the compliance")]
    s_m: Floats
    section_N_m2: Annotated[Matrix, Meta(description="flexural stiffness about n and b at s_m")]


def stiffness_record(k: Any) -> StiffnessRecord:
    """Return the record of a stiffness."""
    shape, arm = k.shape, k.shape.arm
    s, (axes, directions) = np.linspace(0.0, arm.length, _SECTIONS), k.ellipsoid()
    return record_of(
        StiffnessRecord,
        k,
        tensions_N=arm.by_section(shape.tensions),
        tendon_lengths_m=shape.tendon_lengths,
        tip_m=shape.tip,
        position_m=shape.position(k.at),
        half_axes_m_per_N=axes,
        directions=directions,
        locked=[arm.tendon_name(j) for j in k.locked],
        stable=bool(k.stable),
        s_m=s,
        section_N_m2=k.section(s),
    )


class TrajectoryRecord(Record, kw_only=True):
    """Tensions over time, and what the check of them found."""

    schema: Annotated[Literal["octoplan trajectory 1"], Schema]
    outcome: Annotated[str, Meta(description="what happened and what to try")]
    certified: bool
    duration_s: float
    times_s: Annotated[Floats, Meta(description="between which tensions change linearly")]
    tensions_N: Annotated[Matrix, Meta(description="at each time, in tendon order")]
    lengths_m: Annotated[Matrix, Meta(description="of the tendons, at each time")]
    tendons: Annotated[list[str], Meta(description="their names, in tendon order")]
    stops: Annotated[list[int], Meta(description="at which of the times each target is met")]
    reached: list[bool]
    certificate: dict[str, Any]


def trajectory_record(result: Any) -> TrajectoryRecord:
    """Return the record of a motion."""
    checked = result.certificate
    return record_of(
        TrajectoryRecord,
        result,
        certified=checked.passed,
        tensions_N=result.flat,
        tendons=[result.arm.tendon_name(j) for j in range(result.arm.n_tendons)],
        certificate={name: getattr(checked, name) for name in arguments(type(checked))},
    )


class EffectRecord(msgspec.Struct, kw_only=True):
    """One effect, and the scene with and without it; null where one of the two does not settle."""

    effect: Annotated[str, Meta(description="its name, with what had to be switched along")]
    enabled: Annotated[bool, Meta(description="whether the scene has it")]
    tip_change: Annotated[float | None, Meta(description="over arm length")]
    sizes: ProblemSize
    sizes_without: ProblemSize
    time_factor: Annotated[float | None, Meta(description="of a settle, with over without")]
    matters: bool
    problem: Annotated[str, Meta(description="why one does not settle, if so")]


class EffectsRecord(Record, kw_only=True):
    """What each effect does and costs: the scene's own, then others."""

    schema: Annotated[Literal["octoplan effects 1"], Schema]
    accuracy: Annotated[float, Meta(description="tip change over arm length that matters")]
    effects: list[EffectRecord]


def effects_record(switches: Any, accuracy: float) -> EffectsRecord:
    """Return the record of a scene's switched effects."""
    names = EffectRecord.__struct_fields__
    rows = [EffectRecord(**{name: getattr(item, name) for name in names}) for item in switches]
    for row in rows:
        row.time_factor = None if row.problem else row.time_factor
    return record_of(EffectsRecord, None, accuracy=accuracy, effects=rows)


class ExportRecord(Record, kw_only=True):
    """The files of an exported map or arm, and how large and how good it is."""

    schema: Annotated[Literal["octoplan export 1"], Schema]
    files: list[str]
    nodes: Annotated[int, Meta(description="at which a map gives the pose, or of the shape's mesh")]
    error: Annotated[float, Meta(description="estimated tip error over arm length")]
    static_bytes: Annotated[int, Meta(description="of work arrays of C; 0 of other files")]


def export_record(files: Any, shape: Any, static_bytes: int = 0) -> ExportRecord:
    """Return the record of a map, or of a settled arm, that is written for other programs."""
    values = {"files": list(map(str, files)), "nodes": shape.s.size, "static_bytes": static_bytes}
    return record_of(ExportRecord, shape, **values)


class SweepRecord(Record, kw_only=True):
    """A sweep that is finished."""

    schema: Annotated[Literal["octoplan sweep 1"], Schema]
    file: Annotated[str, Meta(description="where the Dataset is")]
    compute: Literal["settle", "plan", "stiffness"]
    dims: Annotated[dict[str, int], Meta(description="what points lie along, and how many there")]
    points: int
    met: Annotated[int, Meta(description="points that settled, or whose targets are reached")]
    failures: Annotated[
        dict[str, int],
        Meta(description="outcomes of the others: one of each kind, that differ by numbers alone"),
    ]
    earlier: Annotated[bool, Meta(description="whether an earlier run had found it all")] = False


def sweep_record(sweep: Any, attributes: dict[str, Any], file: Any, earlier: bool) -> SweepRecord:
    """Return the record of a sweep whose Dataset, with these attributes, is written to a file."""
    return record_of(
        SweepRecord,
        sweep,
        file=str(file),
        compute=sweep.job.compute,
        points=sweep.size,
        met=int(attributes["met"]),
        failures=msgspec.json.decode(attributes["failures"]),
        earlier=earlier,
    )
