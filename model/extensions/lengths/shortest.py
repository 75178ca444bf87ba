"""Lengths that no shape of an arm has, or that crush it: which tendon, and what is the least.

Where no shape has them: held by tendons that stretch, the arm comes as near to them as it can, and
the tendon that falls shortest of its path is pulled hard beside the others. Where the arm is
crushed: the others held as they are, a tendon is paid out up to its length at rest, and where the
arm ceases to settle is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.lengths.least_energy import LeastEnergy
from octoplan.model.paths import Mask
from octoplan.model.support.errors import CollapsedError, InputError, OctoplanError
from octoplan.model.winches import Winches, arm_compliance, rest_lengths

# By what tendons may be too short, over the arm's length.
SHORT = 1e-7
# Compliance of tendons that come as near to their lengths as they can, over the arm's own.
_SOFT = 1e-4
# Tendons that are too short by no less than this share of what another is may be named.
_MOST = 0.1
# Bisections of what is taken in of a tendon.
_HALVINGS = 8


class UnknownLeastError(InputError):
    """No shape is found that has the lengths, nor how short they could be."""


def unknown_least(arm: Arm, winches: Winches) -> UnknownLeastError:
    """Return what to raise where no shape is found: of the tendon that most is taken in of."""
    rest = rest_lengths(arm)
    j = int(np.argmax(np.where(winches.held, (rest - winches.lengths) / rest, -np.inf)))
    message = "more, beside the other lengths: no shape of the arm is found that has these"
    return UnknownLeastError(_name(arm, j), float(winches.lengths[j]), message)


def refuse(program: LeastEnergy, winches: Winches) -> None:
    """Raise InputError where no shape has the lengths: which tendon, what is its least."""
    arm, L = program.system.arm, program.system.arm.length
    compliance = 1 / winches.tendon_EA + _SOFT * arm_compliance(arm) / L
    soft = replace(winches, tendon_EA=1 / compliance)
    nearest = program.least(program.at_rest(), soft.tensions, 1.0, soft)
    if nearest is None:
        return
    lengths = program.lengths(nearest)
    shortfall = np.where(winches.held, -winches.slack_lengths(lengths, nearest.tensions), 0.0)
    if shortfall.max(initial=0.0) <= SHORT * L:
        return
    rest = rest_lengths(arm)
    taken = np.where(shortfall > _MOST * shortfall.max(), 1 - winches.lengths / rest, -np.inf)
    j = int(np.argmax(taken))
    held, T = winches.held.copy(), winches.tensions.copy()
    held[j], T[j] = False, min(nearest.tensions[j], L / arm_compliance(arm))
    pulled = program.least(nearest, T, 1.0, replace(winches, held=held, tensions=T))
    message = f"lengths that go together, the nearest that a shape has is {lengths[j]:.9g} m"
    if pulled is not None:
        message = f"from {program.lengths(pulled)[j]:.7g} m on"
    allowed = f"{message}, beside the other lengths: no shape of the arm has these"
    raise InputError(_name(arm, j), float(winches.lengths[j]), allowed)


def _name(arm: Arm, j: int) -> str:
    return f"lengths[{j}] ({arm.tendon_name(j)})"


def too_short(
    arm: Arm, winches: Winches, problem: OctoplanError, settle: Callable[[Winches], object]
) -> OctoplanError:
    """Return what to tell of lengths that an arm does not settle by.

    A tendon, or all that are taken in, is paid out up to its length at rest; where the arm ceases
    to settle on the way back is found by bisection.

    Parameters
    ----------
    problem : OctoplanError
        What settling by these ended with; returned where nothing else is found.
    settle : callable
        Settles by the lengths of other winches, or raises OctoplanError.
    """
    rest = rest_lengths(arm)
    taken = np.where(winches.held, rest - winches.lengths, 0.0)
    s = getattr(problem, "s", 0.0)
    across = np.array([arm.sections[i].at >= s for i, _ in arm.tendons])
    share = np.where(across, taken / rest, 0.0)
    j = int(np.argmax(share))
    if share[j] <= 0:
        return problem

    def ends(longer: Mask, share: float) -> OctoplanError | None:
        """Return what settling ends with where winches are paid out by a share; None if well."""
        try:
            settle(replace(winches, lengths=winches.lengths + share * np.where(longer, taken, 0.0)))
        except OctoplanError as reason:
            return reason
        return None

    for longer, beside in (
        (np.arange(rest.size) == j, ", beside the other lengths"),
        (taken > 0, ""),
    ):
        if ends(longer, 1.0) is not None:
            continue
        low, high, last = 0.0, 1.0, problem
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            reason = ends(longer, middle)
            if reason is None:
                high = middle
            else:
                low, last = middle, reason
        least = winches.lengths[j] + high * taken[j]
        why = "shorter ones are found no shape for"
        if isinstance(last, CollapsedError):
            why = f"shorter ones crush the arm at s = {last.s:.6g} m"
        from_on = f"from about {least:.5g} m on{beside}"
        if not beside:
            from_on = f"lengths that go together, such as {least:.5g} m with as much of the"
            from_on += " strokes of the others"
        return InputError(_name(arm, j), float(winches.lengths[j]), f"{from_on}: {why}")
    return problem
