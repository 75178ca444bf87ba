"""Manufacturing limits and objectives of a design."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import ArcLength, Direction, value
from octoplan.planner.extensions.fit.unknowns import AT_BOUND
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets import Softest, Stiffest
from octoplan.planner.targets.base import Target, Terms, View

# Number of arc lengths at which wall thicknesses and radii are evaluated.
_STATIONS = 9


@value
class ManufacturingLimits:
    """Limits of the arms that can be manufactured.

    Attributes
    ----------
    wall : float
        Smallest distance of a tendon from the surface [m].
    radius : float
        Smallest radius of the body [m].
    spacing : float
        Smallest distance between anchorages, and from the base to the first anchorage [m].
    """

    wall: ArcLength = 0.0
    radius: ArcLength = 0.0
    spacing: ArcLength = 0.0

    def margins(self, arm: Arm) -> Array:
        """Return the margin of each limit, over the arm's length (n,); all are >= 0 if feasible.

        The last margin is the distance of the tip section's anchorage from the tip.
        """
        return np.concatenate([*self._by_limit(arm).values(), [arm.length - arm.anchorages[0]]])

    def check(self, arm: Arm) -> None:
        """Raise InputError if the given arm violates a limit."""
        smallest = float(self.margins(arm).min())
        if smallest < -AT_BOUND:
            violation = -1e3 * smallest * arm.length
            allowed = f"a limit that the given arm keeps: it misses it by {violation:.3g} mm"
            raise InputError("manufacturing", self, allowed)

    def binding(self, arm: Arm) -> tuple[str, ...]:
        """Return descriptions of the given limits that are active."""
        return tuple(
            f"{name} {1e3 * getattr(self, name):g} mm"
            for name, margins in self._by_limit(arm).items()
            if getattr(self, name) and margins.min() < AT_BOUND
        )

    def _by_limit(self, arm: Arm) -> dict[str, Array]:
        """Return the margins of each limit by name, over the arm's length."""
        share = np.linspace(0.0, 1.0, _STATIONS)
        walls = []
        for i, path in arm.offset_paths:
            end = arm.sections[i].at
            surface = (arm.hull or arm.radius).evaluate(share * end, arm.length)[0]
            walls.append(surface - np.abs(path.evaluate(share * end, end)[0]) - self.wall)
        margins = {
            "radius": arm.radius.evaluate(share * arm.length, arm.length)[0] - self.radius,
            "wall": np.concatenate(walls),
            "spacing": -np.diff([*arm.anchorages, 0.0]) - self.spacing,
        }
        return {name: values / arm.length for name, values in margins.items()}


@value
class Reach(Target):
    """Maximise the tip coordinate along a direction within the tension limits.

    The reach has tensions of its own, in addition to the tensions of the tasks.

    Attributes
    ----------
    direction : (3,)
        Direction in the base frame.
    """

    direction: Direction

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction."""
        return np.array(self.direction)

    def terms(self, view: View, p: Any) -> Terms:
        """See Target.terms."""
        return Terms(objective={"reach": -(p.T @ view.tip) / view.arm.length})


Objective = Literal["effort"] | Stiffest | Softest | Reach


def checked_objective(objective: Any, limits: TendonLimits) -> Objective:
    """Return the objective of a design, or raise InputError if the limits do not allow it."""
    if isinstance(objective, Reach) and not np.all(np.isfinite(limits.upper)):
        raise InputError("tension_max", limits.upper, "finite tensions where a reach is asked for")
    if isinstance(objective, Reach) or np.array_equal(objective, "effort"):
        return objective  # type: ignore[no-any-return]
    if not isinstance(objective, Stiffest | Softest):
        allowed = '"effort", Stiffest(direction), Softest(direction) or Reach(direction)'
        raise InputError("objective", objective, allowed)
    if objective.hold != "tension":
        raise InputError("objective", objective, 'hold="tension": a stiffness with tensions held')
    return objective
