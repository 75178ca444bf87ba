"""Lengths that crush an arm, or that no shape of it is found for: which tendon, what is the least.

The others held as they are, a tendon is paid out up to its length at rest, and where the arm ceases
to settle is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from model.arm import Arm
from model.errors import CollapsedError, InputError, OctoplanError
from model.paths import Array
from model.winches import Winches, rest_lengths

# Bisections of what is taken in of a tendon.
_HALVINGS = 8


def too_short(
    arm: Arm, winches: Winches, problem: OctoplanError, settles: Callable[[Winches], bool]
) -> OctoplanError:
    """Return what to tell of lengths that an arm does not settle by.

    Parameters
    ----------
    problem : OctoplanError
        What settling by these ended with; returned where nothing else is found.
    settles : callable
        Whether the arm settles by the lengths of other winches.
    """
    rest = rest_lengths(arm)
    taken = np.where(winches.held, rest - winches.lengths, 0.0)
    s = getattr(problem, "s", 0.0)
    across = np.array([arm.sections[i].at >= s for i, _ in arm.tendons])
    share = np.where(across, taken / rest, 0.0)
    j = int(np.argmax(share))
    if share[j] <= 0:
        return problem
    alone, all_of_them = np.arange(rest.size) == j, taken > 0
    for own, beside in ((alone, ", beside the other lengths"), (all_of_them, "")):
        lengths = _least(winches, np.where(own, rest, winches.lengths), settles)
        if lengths is None:
            continue
        why = "shorter ones are found no shape for"
        if isinstance(problem, CollapsedError):
            why = f"shorter ones crush the arm at s = {s:.6g} m"
        from_on = f"from about {lengths[j]:.5g} m on{beside}"
        if not beside:
            from_on = f"lengths that go together, such as {lengths[j]:.5g} m with as much of the"
            from_on += " strokes of the others"
        field = f"lengths[{j}] ({arm.tendon_name(j)})"
        return InputError(field, float(winches.lengths[j]), f"{from_on}: {why}")
    return problem


def _least(winches: Winches, longer: Array, settles: Callable[[Winches], bool]) -> Array | None:
    """Return the lengths on the way to longer ones from which on the arm settles; None if none."""

    def at(share: float) -> Winches:
        return replace(winches, lengths=winches.lengths + share * (longer - winches.lengths))

    low, high = 0.0, 1.0
    if not settles(at(high)):
        return None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if settles(at(middle)) else (middle, high)
    return at(high).lengths
