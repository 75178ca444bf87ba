"""How much sooner is a calibration than SciPy's least squares over settle?

Question: modulus and density of the measured tentacle of studies.calibration from 22 shapes, 18
measured ones and the first four again, as the source has so many: how long do `calibrate` and
`scipy.optimize.least_squares` take, from the same start?

Assumptions: processor time, in turn on one core; SciPy differentiates by differences and settles
each shape by `settle` to its default accuracy, 1e-6 of the length, then asks it for the markers'
places; `calibrate` to its own, 1e-5, with all that it checks: that shapes are those reached from
rest, and how far off its mesh is. Libraries are compiled beforehand.

Command: python -m studies.speed fit [--repeats 9]

Answer: in studies/README.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from model import Anchorage, Arm, settle
from model.paths import Array
from planner import Measured, calibrate
from studies.calibration import BODY, LINEAR, shapes
from studies.reporting import asked
from studies.speed.timing import timed

AGAIN = 4


def question(count: int) -> tuple[Arm, list[Measured]]:
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


def main(argv: Sequence[str] | None = None) -> None:
    """Print both times, interpreted and compiled."""
    args = asked(
        __doc__,
        argv,
        {
            "--repeats": 9,
            "--shapes": 22,
            "--interpreted": (False, {"help": "nothing compiled"}),
        },
        prog="python -m studies.speed fit",
    )
    warnings.simplefilter("ignore")
    arm, measured = question(args.shapes)
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
