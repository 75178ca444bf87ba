"""Which physics explains a measured soft tentacle, and how well does it predict unseen shapes?

Question: how far are the markers of the measured shapes of tests/data/measured_tentacle.json (a
hanging silicone cone with two tendons, motion capture, MIT, SoRoMoX contributors) from those of a
calibrated rod, in the shapes that it is calibrated with, in each shape by a fit without it, and in
the shapes of two tendons by a fit to those of one?

Assumptions: exact tendons, weight, tensions as commanded; mean distance over markers [mm]. The
source publishes 15.8 mm for its physics (22 shapes, of which 18 are in the file), and 6.4 mm in
sample for its neural model.

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
from octoplan.planner import Calibration, Measured, Unknown, calibrate
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


# By session what moved between them (the second marker), and of the others what a hand misplaces.
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
    """A model's mean errors [m], and the share of markers left out that lie in their bands."""

    model: str
    unknowns: int
    inside: float
    left_out: float
    held: float
    both: float


def shapes() -> tuple[Arm, list[Measured]]:
    """Return the tentacle as its authors start with it, and its measured shapes."""
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
    """Return the errors of a model, and its calibration with all shapes."""
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
    """Draw the residuals of each marker in each shape, a panel for each model."""
    whole = Figure(figsize=(7.0, 2.4 * len(result)), layout="constrained")
    panels = whole.subplots(len(result), 1, squeeze=False)[:, 0]
    for each, name, ax in zip(result, names, panels, strict=True):
        each.plot(ax)
        ax.set_title(f"{name}: {1e3 * each.mean_error:.3g} mm in the mean", fontsize=9)
    return whole


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--models": (list(MODELS), {"choices": list(MODELS)}),
            "--no-leave-out": (False, {"help": "skip the fits without a shape"}),
            "--out": Path("out"),
        },
    )
    title = ("mean error [mm]", "unknowns", "in sample", "left out", "in band", "two by one")
    print(f"{title[0]:<24}" + "".join(f"{each:>12}" for each in title[1:]))
    all_found = []
    for model in args.models:
        values, result = row(model, not args.no_leave_out)
        numbers = (1e3 * values.inside, 1e3 * values.left_out, values.held, 1e3 * values.both)
        print(f"{values.model:<24}{values.unknowns:>12}" + "".join(f"{x:>12.2f}" for x in numbers))
        all_found.append(result)
    path = args.out / "calibration.png"
    figure(all_found, args.models).savefig(path, dpi=110)
    print(f"figure: {path}")


AGAIN = 4


def repeated_shapes(count: int) -> tuple[Arm, list[Measured]]:
    """Return the tentacle, whose tendons do not turn, and so many shapes, the first ones again."""
    arm, measured = shapes()
    section = arm.sections[0]
    straight = Anchorage(section.at, section.offset, section.angles)
    measured += [replace(each, name=f"{each.name} again") for each in measured[:AGAIN]]
    return replace(arm, sections=(straight,)), measured[:count]


def by_scipy(arm: Arm, measured: Sequence[Measured], compile: bool) -> Array:  # noqa: A002
    """Return modulus [kPa] and density [kg/m3] by SciPy, counted in what the arm has."""
    body = arm.material
    at = np.array([point.s for point in measured[0].points])
    offsets = np.array([point.offset for point in measured[0].points])

    def off(z: Array) -> Array:
        scaled = replace(body, E=body.E * z[0], density=body.density * z[1])
        values, rows = replace(arm, material=scaled), []
        for one in measured:
            shape = settle(values, one.tensions, LINEAR, compile=compile)
            places = shape.position(at) + np.einsum("nij,nj->ni", shape.frame(at), offsets)
            rows.append(np.ravel(places - one.places))
        return np.concatenate(rows)

    result = least_squares(off, [1.0, 1.0], xtol=1e-6, ftol=1e-8).x
    return np.array([body.E / 1e3, body.density]) * result


def fit(argv: Sequence[str] | None = None) -> None:
    """How much sooner is a calibration than SciPy's least squares over settle?

    Question: modulus and density of the measured tentacle of this study from 22 shapes, 18
    measured ones and the first four again, as the source has so many: how long do `calibrate`
    and `scipy.optimize.least_squares` take, from the same start?

    Assumptions: processor time, in turn on one core; SciPy differentiates by differences and
    settles each shape by `settle` to its default accuracy, 1e-6 of the length, then asks it for
    the markers' places; `calibrate` to its own, 1e-5, with all that it checks: that shapes are
    those reached from rest, and how far off its mesh is. Libraries are compiled beforehand.

    Command: python -m studies.speed fit [--repeats 9]

    Answer: in studies/README.md.
    """
    args = asked(
        fit.__doc__,
        argv,
        {
            "--repeats": 9,
            "--shapes": 22,
            "--interpreted": (False, {"help": "nothing compiled"}),
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
        median, result = float(np.median([t for t, _ in ours])), ours[-1][1]
        print(
            f"{'compiled' if compiled else 'interpreted'}: SciPy {theirs:.2f} s, calibrate "
            f"{median:.3f} s, {theirs / median:.1f} times as fast; modulus {result[0]:.3f} kPa, "
            f"by SciPy {other[0]:.3f}"
        )


if __name__ == "__main__":
    main()
