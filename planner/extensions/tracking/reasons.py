"""The limits of a tracking step, and the names of the limits that hold an arm back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octoplan.model.paths import Array
from octoplan.planner.blocks import STRETCH, STROKES, TOTAL_PULL
from octoplan.planner.extensions.tracking.step_program import StepSolution
from octoplan.planner.program_instance import ProgramInstance

# Smallest multiplier of an active limit, over the largest one [-].
_ACTIVE = 1e-3
# Largest distance of a tension from an active limit, over the unit of the tension [-].
_AT_LIMIT = 1e-6
# Name of the stability margin.
STABILITY = "the stability at its margin of {:g}"
# Names of limits by the kind of their rows.
_ROWS = {
    TOTAL_PULL: "the total pull at its maximum",
    STRETCH: "the body, which would be crushed",
}


@dataclass(frozen=True, eq=False)
class StepLimits:
    """The largest changes in a step.

    Attributes
    ----------
    tension : (n_tendons,)
        Change of each tension by its rate [N]; inf without a limit.
    largest : (n_tendons,)
        Change of each tension that the linearised program allows [N].
    stroke : float
        Change of each tendon length by its rate [m]; inf without a limit.
    """

    tension: Array
    largest: Array
    stroke: float

    @property
    def change(self) -> Array:
        """The largest change of each tension (n_tendons,) [N]."""
        return np.minimum(self.tension, self.largest)


def limit_names(
    instance: ProgramInstance, limits: StepLimits, solution: StepSolution, begin: Array, end: Array
) -> list[str]:
    """Return the names of the limits that hold the arm back, by decreasing multiplier.

    `begin` and `end` (n_tendons,) are the tensions before and after the step [N].
    """
    arm = instance.arm
    tolerance = _AT_LIMIT * instance.unit
    lower = np.array(instance.limits.lower)
    upper = np.array(instance.limits.upper)
    lam = solution.bounds[: arm.n_tendons]
    rows = instance.program.row_kinds[: solution.rows.size]
    sizes = np.abs(np.concatenate([solution.bounds, solution.rows, solution.limits]))
    least = _ACTIVE * float(sizes.max(initial=0.0))
    active = list[tuple[float, str]]()
    for j in np.flatnonzero(np.abs(lam) > least).tolist():
        name = arm.tendon_name(j)
        if lam[j] > 0 and end[j] >= upper[j] - tolerance[j]:
            text = f"{name} at its maximum of {upper[j]:g} N"
        elif lam[j] < 0 and end[j] <= lower[j] + tolerance[j]:
            # A minimum of 0 is no limit: tendons cannot push.
            if lower[j] == 0:
                continue
            text = f"{name} at its minimum of {lower[j]:g} N"
        elif limits.tension[j] <= limits.largest[j]:
            text = f"{name} at its largest rate, {limits.tension[j]:g} N in a step"
        else:
            text = f"{name} at the largest change of a step, {limits.largest[j]:.3g} N"
        active.append((abs(float(lam[j])), text))
    for kind, text in _ROWS.items():
        largest = float(np.abs(solution.rows[rows == kind]).max(initial=0.0))
        if largest > least:
            active.append((largest, text))
    of_strokes = solution.rows[rows == STROKES]
    for j in np.flatnonzero(np.abs(of_strokes) > least).tolist():
        active.append((abs(float(of_strokes[j])), f"the stroke of {arm.tendon_name(j)}"))
    # The further limits are the stability, if its margin is near, and the rates of all strokes.
    of_rates = solution.limits[solution.limits.size % arm.n_tendons :]
    if solution.limits.size > of_rates.size and abs(solution.limits[0]) > least:
        text = STABILITY.format(instance.options.stability_bound)
        active.append((abs(float(solution.limits[0])), text))
    for j in np.flatnonzero(np.abs(of_rates) > least).tolist():
        text = f"the stroke rate of {arm.tendon_name(j)}"
        active.append((abs(float(of_rates[j])), text))
    active.sort(key=lambda item: -item[0])
    return [text for _, text in active]
