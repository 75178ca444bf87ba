"""Errors of tendon lengths that no shape has, or that crush the arm.

If no shape has the lengths, the nearest shape is that of extensible tendons with these lengths at
rest. The named tendon is then pulled hard beside the others, which gives its least length.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.lengths.least_energy import LeastEnergy
from octoplan.model.extensions.lengths.winches import Winches
from octoplan.model.support.errors import (
    CollapsedError,
    InputError,
    OctoplanError,
    UnsettledSectionError,
)
from octoplan.model.tendons import arm_compliance, rest_lengths

# Tolerance of tendon lengths, over the arm's length.
SHORT = 1e-7
# Compliance of the tendons of the nearest shape, over that of the arm.
_SOFT = 1e-4
# Smallest shortfall of a tendon that may be named, over the largest shortfall.
_MOST = 0.1


def no_shape(arm: Arm, winches: Winches) -> InputError:
    """Return the error if no shape is found; it names the tendon with the largest stroke."""
    return _too_short(arm, winches, "no shape of the arm is found that has these")


def buckling_lengths(arm: Arm, winches: Winches) -> InputError:
    """Return the error if a span buckles; it names the tendon with the largest stroke."""
    return _too_short(arm, winches, "with these, the arm buckles between its guides")


def _too_short(arm: Arm, winches: Winches, reason: str) -> InputError:
    rest = rest_lengths(arm)
    j = int(np.argmax(np.where(winches.held, (rest - winches.lengths) / rest, -np.inf)))
    allowed = f"more, beside the other lengths: {reason}"
    return InputError(_name(arm, j), float(winches.lengths[j]), allowed)


def refuse(program: LeastEnergy, winches: Winches) -> None:
    """Raise InputError if no shape has the lengths; it names a tendon and its least length."""
    arm = program.system.arm
    L = program.system.arm.length
    compliance = 1 / winches.tendon_EA + _SOFT * arm_compliance(arm) / L
    soft = replace(winches, tendon_EA=1 / compliance)
    nearest = program.minimise(program.at_rest(), soft.tensions, 1.0, soft)
    if nearest is None:
        return
    lengths = program.lengths(nearest)
    shortfall = np.where(winches.held, -winches.slack_lengths(lengths, nearest.tensions), 0.0)
    if shortfall.max(initial=0.0) <= SHORT * L:
        return
    rest = rest_lengths(arm)
    taken = np.where(shortfall > _MOST * shortfall.max(), 1 - winches.lengths / rest, -np.inf)
    j = int(np.argmax(taken))
    held = winches.held.copy()
    T = winches.tensions.copy()
    held[j] = False
    T[j] = min(nearest.tensions[j], L / arm_compliance(arm))
    pulled = program.minimise(nearest, T, 1.0, replace(winches, held=held, tensions=T))
    message = f"lengths that go together, the nearest that a shape has is {lengths[j]:.9g} m"
    if pulled is not None:
        message = f"from {program.lengths(pulled)[j]:.7g} m on"
    allowed = f"{message}, beside the other lengths: no shape of the arm has these"
    raise InputError(_name(arm, j), float(winches.lengths[j]), allowed)


def _name(arm: Arm, j: int) -> str:
    return f"lengths[{j}] ({arm.tendon_name(j)})"


def crushing_lengths(
    arm: Arm, winches: Winches, reason: CollapsedError | UnsettledSectionError
) -> OctoplanError:
    """Return the error of lengths with which a cross-section has no equilibrium.

    The message names the tendon across this section with the largest relative stroke. The result is
    the `reason` if no tendon across the section is shorter than at rest.
    """
    rest = rest_lengths(arm)
    strokes = np.where(winches.held, rest - winches.lengths, 0.0)
    crosses = np.array([arm.sections[i].at >= reason.s for i, _ in arm.tendons])
    relative = np.where(crosses, strokes / rest, 0.0)
    j = int(np.argmax(relative))
    if relative[j] <= 0:
        return reason
    crushed = f"these lengths crush the arm at s = {reason.s:.6g} m"
    allowed = f"more, up to {rest[j]:.6g} m at rest, beside the other lengths: {crushed}"
    return InputError(_name(arm, j), float(winches.lengths[j]), allowed)
