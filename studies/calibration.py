"""Which physics explains a measured soft tentacle, and how well are unseen shapes predicted?

Question: How far are the measured markers of tests/data/measured_tentacle.json (a hanging silicone
cone with two tendons, motion capture, MIT, SoRoMoX contributors) from the markers of a calibrated
rod? The study reports the error in the shapes of the fit, in each shape after a fit without this
shape, and in the shapes with two taut tendons after a fit to the shapes with one.

Assumptions: Exact tendons, weight, tensions as commanded. Errors are mean distances over markers
[mm]. The source publishes 15.8 mm for its physics (22 shapes, of which 18 are in the file), and
6.4 mm in sample for its neural model.

Command: python -m studies.calibration [--models ...] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, Weight
from octoplan.model.paths import Array
from octoplan.planner import Measured, Unknown, calibrate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.least_squares import Loss
from octoplan.planner.extensions.fit.residuals import mean_distance
from studies.reporting import asked
from studies.speed.timing import timed

DATA = Path(__file__).parents[1] / "tests" / "data" / "measured_tentacle.json"
LINEAR = Scene(Extension(), ExactTendons(), Weight())
RUBBER = Scene(Extension(), ExactTendons(), NeoHookean(), Weight())
DOWN = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
BODY = [Unknown("arm.E_kPa", 50, 1000), Unknown("arm.density", 500, 2500)]
POSE = [
    *(Unknown(f"arm.base_position_mm[{i}]", -20, 20) for i in range(3)),
    *(Unknown(f"arm.base_rotation_deg[{i}]", -10, 10) for i in range(3)),
]
TENDONS = [
    Unknown("arm.sections[0].turn_deg[1]", -60, 60),
    Unknown("arm.sections[0].offset_mm[0]", 8, 15),
    Unknown("arm.sections[0].offset_mm[1]", 1, 6),
    Unknown("arm.sections[0].angles_deg[1]", 130, 170),
    Unknown("tension_scale[1]", 0.5, 2.0),
]


def _marker(point: int, axis: int, session: str | None = None) -> Unknown:
    return Unknown(f"points[{point}].offset_mm[{axis}]", -60, 60, session=session)


# Errors of marker placement. The second marker moved between sessions, so that its coordinates are
# unknown in each session; other coordinates are unknown if a placement by hand is inaccurate.
MARKERS = [
    *(_marker(*each) for each in ((0, 2), (2, 2), (3, 0), (3, 2))),
    *(_marker(1, 0, session) for session in "AB"),
    _marker(1, 1, "B"),
    *(_marker(3, 1, session) for session in "AB"),
    _marker(0, 1, "A"),
    Unknown("arm.base_position_mm[0]", -20, 20, session="A"),
]
MODELS: dict[str, tuple[Scene, list[Unknown], Loss]] = {
    "modulus and density": (LINEAR, BODY, "linear"),
    "the same, neo-Hookean": (RUBBER, BODY, "linear"),
    "and base pose": (LINEAR, [*BODY, *POSE], "linear"),
    "tendons and markers": (RUBBER, [*BODY, POSE[2], POSE[5], *TENDONS, *MARKERS], "soft_l1"),
}


@dataclass(frozen=True)
class Row:
    """Mean errors of a model [m], and the share of left-out markers inside their bands.

    `in_sample` is the error in the shapes of the fit, `left_out` in each shape after a fit without
    this shape, and `both` in shapes with two taut tendons after a fit to shapes with one.
    """

    model: str
    unknowns: int
    in_sample: float
    left_out: float
    in_band: float
    both: float


def shapes() -> tuple[Arm, list[Measured]]:
    """Return the tentacle with the initial parameters of its authors, and the measured shapes."""
    data = json.loads(DATA.read_text())
    tendons = data["geometry"]["tendons"]
    anchorage = Anchorage(
        tendons["end_s_m"],
        Linear(tendons["offset_base_m"], tendons["offset_end_m"]),
        tuple(np.radians(tendons["angles_deg"]).tolist()),
        Linear(0.0, 0.0),
    )
    links = data["geometry"]["links"]
    length = sum(link["length_m"] for link in links)
    radius = Linear(links[0]["radius_base_m"], links[-1]["radius_end_m"])
    arm = Arm(length, radius, (anchorage,), Material(315e3, 0.45, 1320.0), DOWN)
    markers = data["markers"]
    places = list(zip(markers["s_m"], markers["offset_local_tnb_m"], strict=True))
    measured = [
        Measured(
            each["tensions_N"],
            [(*place, seen) for place, seen in zip(places, each["markers_m"], strict=True)],
            session=each["session"],
            name=each["file"],
        )
        for each in data["shapes"]
    ]
    return arm, measured


def row(model: str, leave_out: bool) -> tuple[Row, Calibration]:
    """Return the errors of a model, and the calibration with all shapes."""
    scene, unknowns, loss = MODELS[model]
    arm, measured = shapes()
    result = calibrate(arm, scene, measured, unknowns, loss=loss)
    single = [shape for shape in measured if min(shape.tensions) == 0]
    both = [shape for shape in measured if min(shape.tensions) > 0]
    trained = calibrate(arm, scene, single, unknowns, loss=loss)
    left = result.leave_out() if leave_out else None
    errors = (
        result.mean_error,
        left.mean_error if left else np.nan,
        float(np.mean(left.held)) if left else np.nan,
        mean_distance(trained.errors(both)),
    )
    return Row(model, len(unknowns), *errors), result


def figure(result: Sequence[Calibration], names: Sequence[str]) -> Figure:
    """Draw the residuals of each marker in each shape, with one panel for each model."""
    whole = Figure(figsize=(7.0, 2.4 * len(result)), layout="constrained")
    panels = whole.subplots(len(result), 1, squeeze=False)[:, 0]
    for each, name, ax in zip(result, names, panels, strict=True):
        each.plot(ax)
        ax.set_title(f"{name}: mean {1e3 * each.mean_error:.3g} mm", fontsize=9)
    return whole


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--models": (list(MODELS), {"choices": list(MODELS)}),
            "--no-leave-out": (False, {"help": "skip the fits that leave out one shape"}),
            "--out": Path("out"),
        },
    )
    title = ("mean error [mm]", "unknowns", "in sample", "left out", "in band", "two by one")
    print(f"{title[0]:<24}" + "".join(f"{each:>12}" for each in title[1:]))
    all_found = []
    for model in args.models:
        values, result = row(model, not args.no_leave_out)
        cells = (
            1e3 * values.in_sample,
            1e3 * values.left_out,
            values.in_band,
            1e3 * values.both,
        )
        print(f"{values.model:<24}{values.unknowns:>12}" + "".join(f"{x:>12.2f}" for x in cells))
        all_found.append(result)
    path = args.out / "calibration.png"
    figure(all_found, args.models).savefig(path, dpi=110)
    print(f"figure: {path}")


# Number of shapes that the timing study repeats, for as many shapes as in the source.
REPEATED = 4


def repeated_shapes(count: int) -> tuple[Arm, list[Measured]]:
    """Return the tentacle with straight tendons, and `count` shapes.

    The first REPEATED shapes follow a second time after the measured ones.
    """
    arm, measured = shapes()
    section = arm.sections[0]
    straight = Anchorage(section.at, section.offset, section.angles)
    measured += [replace(each, name=f"{each.name} again") for each in measured[:REPEATED]]
    return replace(arm, sections=(straight,)), measured[:count]


def by_scipy(arm: Arm, measured: Sequence[Measured], compile: bool) -> Array:  # noqa: A002
    """Return modulus [kPa] and density [kg/m3] from SciPy, scaled by the values of the arm."""
    body = arm.material
    at = np.array([point.s for point in measured[0].points])
    offsets = np.array([point.offset for point in measured[0].points])

    def off(z: Array) -> Array:
        scaled = replace(body, E=body.E * z[0], density=body.density * z[1])
        values = replace(arm, material=scaled)
        rows = []
        for one in measured:
            shape = settle(values, one.tensions, LINEAR, compile=compile)
            places = shape.position(at) + np.einsum("nij,nj->ni", shape.frame(at), offsets)
            rows.append(np.ravel(places - one.places))
        return np.concatenate(rows)

    result = least_squares(off, [1.0, 1.0], xtol=1e-6, ftol=1e-8).x
    return np.array([body.E / 1e3, body.density]) * result


def fit(argv: Sequence[str] | None = None) -> None:
    """How fast is a calibration compared with SciPy's least squares over `settle`?

    Question: How long do `calibrate` and `scipy.optimize.least_squares` take for the modulus and
    the density of the measured tentacle, from the same start? The data are 22 shapes, the number
    in the source: 18 measured ones, and the first four a second time.

    Assumptions: Processor time, both in turn on one core. SciPy uses finite differences and calls
    `settle` for each shape with the default accuracy, 1e-6 of the length. `calibrate` uses its
    default accuracy, 1e-5, and includes its checks: the shapes are continuations from rest, and the
    mesh is fine enough. Libraries are compiled beforehand.

    Command: python -m studies.speed fit [--repeats 9]

    Answer: in studies/README.md.
    """
    args = asked(
        fit.__doc__,
        argv,
        {
            "--repeats": 9,
            "--shapes": 22,
            "--interpreted": (False, {"help": "measure without compiled functions only"}),
        },
        prog="python -m studies.speed fit",
    )
    warnings.simplefilter("ignore")
    arm, measured = repeated_shapes(args.shapes)
    for compiled in [False] if args.interpreted else [False, True]:

        def own(compile: bool = compiled) -> Array:  # noqa: A002
            return calibrate(arm, LINEAR, measured, BODY, compile=compile).array

        own()
        settle(arm, measured[0].tensions, LINEAR, compile=compiled)
        theirs, other = timed(lambda on=compiled: by_scipy(arm, measured, on))  # type: ignore[misc]
        ours = [timed(own) for _ in range(args.repeats)]
        median = float(np.median([t for t, _ in ours]))
        result = ours[-1][1]
        print(
            f"{'compiled' if compiled else 'interpreted'}: SciPy {theirs:.2f} s, calibrate "
            f"{median:.3f} s, {theirs / median:.1f} times as fast; modulus {result[0]:.3f} kPa, "
            f"with SciPy {other[0]:.3f}"
        )


if __name__ == "__main__":
    main()
