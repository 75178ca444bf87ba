"""Results as records with a schema: the JSON output of commands and saved results.

Numbers are in SI units and angles in rad; keys end in the unit of the numbers. As long as the
number at the end of `schema` stays, keys are added but never renamed or removed. A key is an
attribute of the result, up to the unit; otherwise `about` has a function of the result.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta

from octoplan.model.compliance import length_error
from octoplan.model.loads import is_coupled
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.model.support.progress import OutOfTime
from octoplan.model.tendons import strokes
from octoplan.planner.frontends.accuracy_study import AccuracyPoint
from octoplan.planner.frontends.arm_check import Comparison
from octoplan.planner.frontends.effect_ablation import Switch
from octoplan.planner.frontends.io.codec import hints_of
from octoplan.planner.frontends.io.files import versions
from octoplan.planner.frontends.io.tables import attribute_descriptions, sentence


def about(text: str = "", of: Callable[[Any], Any] | None = None) -> Meta:
    """Return the metadata of a key: a description, and a function of the result if needed.

    The modules of records evaluate annotations at once, so that annotations can refer to functions.
    """
    return Meta(description=text or None, extra={"of": of})


# Stations of a shape, and of the stiffness of cross-sections.
POINTS = 101
_SECTIONS = 21

Rows = Annotated[Any, about("one row per section, tip first, or flat")]
Floats = list[float]
Matrix = list[list[float]]
Schema = Meta(description="kind and version of this record")
R = TypeVar("R", bound=msgspec.Struct)


class Record(msgspec.Struct, kw_only=True):
    """The result of a command."""

    versions: Annotated[dict[str, str], about("of octoplan and libraries", lambda _: versions())]


def record(kind: type[R], result: Any, **others: Any) -> R:
    """Return the record of a result; `others` are keys that the result does not have."""
    keys = [key for key in kind.__struct_fields__ if key not in others]
    return kind(**others, **{key: _value(kind, key, result) for key in keys})


def derived(kind: Any, *left_out: str, **more: Any) -> Any:
    """Return the record type of a class: fields except `left_out`, and more keys.

    Descriptions are taken from the docstring. Infinite numbers and NaN become null.
    """
    descriptions = attribute_descriptions(kind)
    fields = [
        (name, Annotated[_or_null(hint), about(descriptions.get(name, ""))])
        for name, hint in hints_of(kind).items()
        if name not in left_out
    ]
    space = {"__doc__": sentence(kind)}
    return msgspec.defstruct(f"{kind.__name__}Record", [*fields, *more.items()], namespace=space)


def _or_null(hint: Any) -> Any:
    if get_origin(hint) is Mapping:
        return dict[str, _or_null(get_args(hint)[1])]  # type: ignore[misc]
    return float | None if hint is float else hint


def records(kind: type[R], results: Any) -> list[R]:
    """Return the record of each result."""
    return [record(kind, result) for result in results]


def schema_name(kind: Any) -> str:
    """Return the schema of a kind of record, "octoplan KIND VERSION"."""
    return str(get_args(hints_of(kind)["schema"].__origin__)[0])


def _value(kind: Any, key: str, result: Any) -> Any:
    hint = hints_of(kind)[key]
    if key == "schema":
        return schema_name(kind)
    for item in getattr(hint, "__metadata__", ()):
        if isinstance(item, Meta) and item.extra and item.extra.get("of"):
            return item.extra["of"](result)
    while not hasattr(result, key):
        key = key.rpartition("_")[0]
    return getattr(result, key)


def _stations(shape: Any) -> Any:
    return np.linspace(0.0, shape.arm.length, POINTS)


def _sections(k: Any) -> Any:
    return np.linspace(0.0, k.shape.arm.length, _SECTIONS)


def stability_under_loads(shape: Shape) -> float | None:
    """Return the stability of a shape; None without loads, and if the scene has no energy."""
    if not is_coupled(shape.arm, shape.scene):
        return None
    with suppress(InputError):
        return shape.stability
    return None


class ShapeRecord(Record, kw_only=True):
    """A settled shape."""

    schema: Annotated[Literal["octoplan shape 1"], Schema]
    tip_m: Floats
    tip_frame: Annotated[Matrix, about("columns t, n, b")]
    tensions_N: Annotated[Rows, about(of=lambda shape: shape.arm.by_section(shape.tensions))]
    error: Annotated[float, about("estimated tip error over arm length")]
    stability: Annotated[
        float | None,
        about("1 at rest, 0 at buckling; null without loads", stability_under_loads),
    ]
    tendon_lengths_m: Annotated[Floats, about("in tendon order")]
    strokes_m: Annotated[Floats, about("taken in from the straight arm at rest", strokes)]
    slack: Annotated[list[bool], about("in tendon order", lambda shape: shape.slack.ravel())]
    s_m: Annotated[Floats, about("arc lengths from the base", _stations)]
    position_m: Annotated[Matrix, about("at s_m", lambda shape: shape.position(_stations(shape)))]
    strain: Annotated[
        Matrix,
        about("tau, xi, k [1/m] and q [-] at s_m", lambda shape: shape.strain(_stations(shape))),
    ]


def of_shape(plan: Any) -> dict[str, Any]:
    """Return the keys of a plan that depend on its shape; None if no equilibrium exists."""
    keys = ("tip_m", "tip_frame", "slack", "lengths_m", "strokes_m", "tip_error_per_length")
    result: dict[str, Any] = dict.fromkeys(keys)
    with suppress(OctoplanError, OutOfTime):
        shape = plan.shape
        result |= {"tip_m": shape.tip, "tip_frame": shape.tip_frame, "slack": shape.slack}
        result["tip_error_per_length"] = length_error(shape)
        result |= {"lengths_m": plan.lengths, "strokes_m": plan.strokes}
    return result


class StiffnessRecord(Record, kw_only=True):
    """The compliance of a settled shape at a point, and the flexural stiffness."""

    schema: Annotated[Literal["octoplan stiffness 1"], Schema]
    tensions_N: Annotated[Rows, about(of=lambda k: k.shape.arm.by_section(k.shape.tensions))]
    tendon_lengths_m: Annotated[Floats, about("in tendon order", lambda k: k.shape.tendon_lengths)]
    tip_m: Annotated[Floats, about(of=lambda k: k.shape.tip)]
    hold: Annotated[
        Literal["tension", "length"], about("quantity of the tendons that is held constant")
    ]
    at_m: Annotated[float, about("arc length of the point")]
    position_m: Annotated[
        Floats, about("of the point, base frame", lambda k: k.shape.position(k.at))
    ]
    compliance: Annotated[
        Matrix, about("[displacement m; rotation rad] per [force N; moment N m], base frame")
    ]
    half_axes_m_per_N: Annotated[
        Floats, about("of displacements, softest first", lambda k: k.ellipsoid()[0])
    ]
    directions: Annotated[Matrix, about("of the half axes, as columns", lambda k: k.ellipsoid()[1])]
    tension_response: Annotated[Matrix, about("of each tendon per force and moment")]
    locked: Annotated[
        list[str],
        about(
            "tendons whose length is held", lambda k: [k.shape.arm.tendon_name(j) for j in k.locked]
        ),
    ]
    slack: Annotated[list[str], about("tendons without tension")]
    stable: Annotated[bool, about("at constant tensions", lambda k: bool(k.stable))]
    error: Annotated[float, about("estimated relative error of the compliance")]
    s_m: Annotated[Floats, about(of=_sections)]
    section_N_m2: Annotated[
        Matrix, about("flexural stiffness about n and b at s_m", lambda k: k.section(_sections(k)))
    ]


class TrajectoryRecord(Record, kw_only=True):
    """Tensions over time, and the certificate."""

    schema: Annotated[Literal["octoplan trajectory 1"], Schema]
    outcome: Annotated[str, about("the result, and a remedy if it failed")]
    certified: Annotated[bool, about(of=lambda motion: motion.certificate.passed)]
    duration_s: float
    times_s: Annotated[Floats, about("tensions are linear between these times")]
    tensions_N: Annotated[
        Matrix, about("at each time, in tendon order", lambda motion: motion.flat)
    ]
    lengths_m: Annotated[Matrix, about("of the tendons, at each time")]
    base: Annotated[
        Matrix, about("insertion [m] and rotation [rad] of the base at each time; 0 if it is fixed")
    ]
    tendons: Annotated[
        list[str], about("names, in tendon order", lambda motion: motion.arm.tendon_names)
    ]
    stops: Annotated[list[int], about("index of the time at which each target is met")]
    reached: list[bool]
    certificate: Annotated[
        dict[str, Any],
        about(
            "results of the verification, see MotionCertificate",
            lambda motion: motion.certificate.numbers,
        ),
    ]


AccuracyPointRecord: Any = derived(AccuracyPoint)


def _points(name: str) -> Meta:
    """Return the metadata of a curve of an accuracy study."""
    return about(of=lambda study: records(AccuracyPointRecord, getattr(study, name)))


class AccuracyRecord(Record, kw_only=True):
    """Verified errors and times of settling and planning, and the recommended accuracy."""

    schema: Annotated[Literal["octoplan accuracy 1"], Schema]
    recommended: Annotated[float | None, about("the accuracy to use; null if none succeeded")]
    recommendation: Annotated[str, about("in one sentence")]
    settling: Annotated[list[AccuracyPointRecord], _points("settling")]
    planning: Annotated[list[AccuracyPointRecord], _points("planning")]
    reference: Annotated[float, about("smaller errors are not resolved")]
    reference_scheme: Annotated[str, about("method of the reference")]


ComparisonRecord: Any = derived(Comparison)


class CheckRecord(Record, kw_only=True):
    """Random tensions, and the comparisons of their shapes."""

    schema: Annotated[Literal["octoplan check 1"], Schema]
    outcome: Annotated[str, about("the result in one or two sentences")]
    passed: bool
    tensions_N: Annotated[Matrix, about("one row per set, in tendon order")]
    settled: Annotated[list[bool], about("whether each set has a reference shape")]
    refusals: Annotated[list[str], about("errors of the sets without a reference shape")]
    comparisons: Annotated[
        list[ComparisonRecord],
        about(of=lambda check: records(ComparisonRecord, check.comparisons)),
    ]


EffectRecord: Any = derived(Switch)


class EffectsRecord(Record, kw_only=True):
    """Tip change and run time of each effect: first those of the scene, then others."""

    schema: Annotated[Literal["octoplan effects 1"], Schema]
    accuracy: Annotated[float, about("tip error over arm length of the settled shapes")]
    tolerance: Annotated[float, about("tip change over arm length above which an effect matters")]
    length_m: Annotated[float, about("of the arm")]
    effects: Annotated[
        list[EffectRecord], about(of=lambda switches: records(EffectRecord, switches))
    ]


class ExportRecord(Record, kw_only=True):
    """The files of an exported map or arm, with size and error."""

    schema: Annotated[Literal["octoplan export 1"], Schema]
    files: list[str]
    nodes: Annotated[
        int,
        about("nodes of the map's poses, or of the shape's mesh", lambda shape: shape.s.size),
    ]
    error: Annotated[float, about("estimated tip error over arm length")]
    static_bytes: Annotated[int, about("of C work arrays; 0 for other files")]


class SweepRecord(Record, kw_only=True):
    """A finished sweep."""

    schema: Annotated[Literal["octoplan sweep 1"], Schema]
    file: Annotated[str, about("path of the Dataset")]
    compute: Annotated[
        Literal["settle", "plan", "stiffness"], about(of=lambda sweep: sweep.job.compute)
    ]
    dims: Annotated[dict[str, int], about("dimensions of the grid of points, with sizes")]
    points: Annotated[int, about(of=lambda sweep: sweep.size)]
    met: Annotated[int, about("number of points that settled, or whose targets are reached")]
    failures: Annotated[
        dict[str, int],
        about("number of failures by outcome; outcomes that differ in numbers only are merged"),
    ]
    earlier: Annotated[bool, about("whether an earlier run computed everything")] = False


class WorkspaceRecord(Record, kw_only=True):
    """A finished workspace."""

    schema: Annotated[Literal["octoplan workspace 1"], Schema]
    file: Annotated[str | None, about("path of the Dataset; null if it was not written")]
    sample: Annotated[int, about("number of sampled tensions with a stable shape")]
    probe: Annotated[int, about("number of plans whose tips are not on the boundary")]
    boundary: Annotated[int, about("number of plans whose tips are nearest to a target beyond")]
    refused: Annotated[int, about("number of samples and plans without a stable shape")]
    failures: Annotated[
        dict[str, int],
        about("number of refusals by reason; reasons that differ in numbers only are merged"),
    ]
    tip_min_m: Annotated[Floats, about("smallest x, y and z of the tips")]
    tip_max_m: Annotated[Floats, about("largest x, y and z of the tips")]
    effort_max_N: Annotated[float, about("largest effort of the tips")]
    largest_gap_m: Annotated[
        float, about("largest distance from the tips of a point that no plan has classified")
    ]
    earlier: Annotated[bool, about("whether an earlier run computed everything")] = False
