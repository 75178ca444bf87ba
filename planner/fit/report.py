"""The outcome of a calibration, in sentences."""

from __future__ import annotations

import numpy as np

from model.text import counted
from planner.fit.fitted import Fitted

# How near misfits are of starts that came to one optimum.
_SAME = 1e-3
# Tensions over the arm's E A that crush it: they are likely in another unit.
_CRUSHING = 10.0


def outcome(of: Fitted) -> str:
    """Return what was found, how well it is known, and what to try."""
    size = sum(shape.size for shape in of.measured)
    counts = [(len(of.measured), "shape"), (size, "number"), (len(of.unknowns), "unknown")]
    found = f"residuals are {of.noise:.3g} times the standard deviations given"
    if np.isfinite(of.mean_error):
        found = f"markers are {1e3 * of.mean_error:.3g} mm off in the mean"
    lines = [f"{', '.join(counted(n, what) for n, what in counts)}: {found}."]
    if of.stopped:
        lines.append("Stopped at the time limit: the values are the best so far.")
    lines += [f"{line[0].upper()}{line[1:]}." for line in map(str, of.unidentified)]
    if of.at_bounds:
        lines.append(f"At a bound: {', '.join(of.at_bounds)}; widen it, or doubt the model.")
    if of.at_priors:
        lines.append(f"The data say no more than the prior of {', '.join(of.at_priors)}.")
    lines += [f"{name} is left out: {why}." for name, why in of.left_out]
    lines += _far(of)
    if of.astray:
        lines.append(
            f"The fit had {', '.join(of.astray)} on a branch that the arm does not take from rest; "
            "it was begun again from there. Check for another optimum with more starts."
        )
    return " ".join([*lines, *_starts(of)])


def _far(of: Fitted) -> list[str]:
    """Return which shapes are not reached, and which not as well as others."""
    lines, far = [], of.unreached
    unlike = [name for name in of.unlike if name not in far]
    if far:
        lines.append(
            f"No values within the bounds reach {', '.join(far)}: markers are off by more than a "
            "tenth of the arm's length; check tensions and markers there, units, the order of the "
            "tendons, and the bounds."
        )
        most = max((max(shape.tensions or (0.0,)) for shape in of.measured), default=0.0)
        radius = of.given_arm.radius.evaluate(np.zeros(1), of.given_arm.length)[0][0]
        stiff = of.given_arm.material.E * np.pi * radius**2
        if most > _CRUSHING * stiff:
            lines.append(
                f"Tensions of up to {most:g} N are {most / stiff:.3g} times the arm's E A at its "
                f"base, {stiff:.3g} N: are they in mN?"
            )
    if unlike:
        lines.append(
            f"No values within the bounds reach {', '.join(unlike)} as well as the others: "
            "check tensions and markers there, or fit with a robust loss."
        )
    return lines


def _starts(of: Fitted) -> list[str]:
    """Return how many of several starts came to the optimum."""
    if len(of.starts) == 1:
        return []
    best = min(start.misfit for start in of.starts)
    there = [start for start in of.starts if start.misfit <= best + _SAME * abs(best) + _SAME]
    lost = sum(start.found is None for start in of.starts)
    others = len(of.starts) - len(there) - lost
    line = f"{len(there)} of {len(of.starts)} starts came to this optimum"
    line += f", {others} to worse ones" if others else ""
    line += f", {lost} to no shapes that settle" if lost else ""
    given = of.starts[0]
    if given not in there and given.found is not None:
        line += "; the given values lead to a worse one: it is another basin"
    return [f"{line}."]
