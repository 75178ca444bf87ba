"""What a calibration found, in sentences."""

from __future__ import annotations

import numpy as np

from model.text import counted
from planner.calibrate.fitted import Fitted

_SAME = 1e-3
# Tensions over the arm's E A that crush it: they are likely in another unit.
_CRUSHING = 10.0


def outcome(of: Fitted) -> str:
    """Return what was found, how well it is known, and what to try."""
    size = sum(shape.size for shape in of.measured)
    counts = [(len(of.measured), "shape"), (size, "number"), (len(of.unknowns), "unknown")]
    told = [f"{', '.join(counted(n, what) for n, what in counts)}: {_error(of)}."]
    told += [f"{line[0].upper()}{line[1:]}." for line in map(str, of.unidentified)]
    if of.at_bounds:
        told.append(f"At a bound: {', '.join(of.at_bounds)}; widen it, or doubt the model.")
    if of.at_priors:
        told.append(f"The data say no more than the prior of {', '.join(of.at_priors)}.")
    told += _far(of)
    if of.astray:
        told.append(
            f"The fit had {', '.join(of.astray)} on a branch that the arm does not take from rest; "
            "it was begun again from there. Check for another optimum with more starts."
        )
    return " ".join([*told, *_starts(of)])


def _far(of: Fitted) -> list[str]:
    """Return which shapes are not reached, and which not as well as others."""
    told, far, unlike = [], of.unreached, [own for own in of.unlike if own not in of.unreached]
    if far:
        told.append(
            f"No values within the bounds reach {', '.join(far)}: markers are off by more than a "
            "tenth of the arm's length; check tensions and markers there, units, and the bounds."
        )
        most = max(max(shape.tensions) for shape in of.measured)
        radius = of.given_arm.radius.evaluate(np.zeros(1), of.given_arm.length)[0][0]
        stiff = of.given_arm.material.E * np.pi * radius**2
        if most > _CRUSHING * stiff:
            told.append(
                f"Tensions of up to {most:g} N are {most / stiff:.3g} times the arm's E A at its "
                f"base, {stiff:.3g} N: are they in mN?"
            )
    if unlike:
        told.append(
            f"No values within the bounds reach {', '.join(unlike)} as well as the others: "
            "check tensions and markers there, or fit with a robust loss."
        )
    return told


def _error(of: Fitted) -> str:
    if np.isfinite(of.mean_error):
        return f"markers are {1e3 * of.mean_error:.3g} mm off in the mean"
    return f"residuals are {of.noise:.3g} times the standard deviations given"


def _starts(of: Fitted) -> list[str]:
    """Return how many of several starts came to the optimum."""
    if len(of.starts) == 1:
        return []
    best = min(start.misfit for start in of.starts)
    there = [start for start in of.starts if start.misfit <= best + _SAME * abs(best) + _SAME]
    lost = sum(start.found is None for start in of.starts)
    others = len(of.starts) - len(there) - lost
    told = f"{len(there)} of {len(of.starts)} starts came to this optimum"
    told += f", {others} to worse ones" if others else ""
    told += f", {lost} to no shapes that settle" if lost else ""
    given = of.starts[0]
    if given not in there and given.found is not None:
        told += "; the given values lead to a worse one: it is another basin"
    return [f"{told}."]
