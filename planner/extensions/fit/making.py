"""What a design makes best, and the limits of what can be made."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.support.errors import InputError
from octoplan.model.support.quantities import ArcLength, Direction
from octoplan.model.support.value import value
from octoplan.planner.extensions.fit.unknowns import AT_BOUND
from octoplan.planner.question import Limits
from octoplan.planner.targets import Softest, Stiffest
from octoplan.planner.targets.base import Target, Terms, View

# Places along the arm at which walls and radii are evaluated.
_STATIONS = 9


@value
class Making:
    """Limits of what can be made.

    Attributes
    ----------
    wall : float
        Least distance of a tendon from the surface [m].
    radius : float
        Least radius of the body [m].
    spacing : float
        Least distance between anchorages, and from the base to the first [m].
    """

    wall: ArcLength = 0.0
    radius: ArcLength = 0.0
    spacing: ArcLength = 0.0

    def room(self, arm: Arm) -> Array:
        """Return what is left of each limit over the arm's length (n,): 0 or above can be made."""
        return np.concatenate([*self._margins(arm).values(), [arm.length - arm.anchorages[0]]])

    def check(self, arm: Arm) -> None:
        """Raise InputError where an arm to begin with cannot be made."""
        room = float(self.room(arm).min())
        if room < -AT_BOUND:
            violation = -1e3 * room * arm.length
            allowed = f"a limit that the given arm keeps: it misses it by {violation:.3g} mm"
            raise InputError("making", self, allowed)

    def binding(self, arm: Arm) -> tuple[str, ...]:
        """Return what an arm has no room left of, in words; only of limits that were given."""
        return tuple(
            f"{name} {1e3 * getattr(self, name):g} mm"
            for name, room in self._margins(arm).items()
            if getattr(self, name) and room.min() < AT_BOUND
        )

    def _margins(self, arm: Arm) -> dict[str, Array]:
        """Return what is left of each limit, over the arm's length."""
        share = np.linspace(0.0, 1.0, _STATIONS)
        walls = []
        for i, path in arm.offset_paths:
            end = arm.sections[i].at
            surface = (arm.hull or arm.radius).evaluate(share * end, arm.length)[0]
            walls.append(surface - np.abs(path.evaluate(share * end, end)[0]) - self.wall)
        radius = arm.radius.evaluate(share * arm.length, arm.length)[0] - self.radius
        spacing = -np.diff([*arm.anchorages, 0.0]) - self.spacing
        rooms = {"radius": radius, "wall": np.concatenate(walls), "spacing": spacing}
        return {name: room / arm.length for name, room in rooms.items()}


@value
class Reach(Target):
    """The farthest place of the tip along a direction (3,), base frame, within the tension limits.

    By tensions of its own, beside those of the tasks.

    Attributes
    ----------
    direction : (3,)
        In the base frame.
    """

    direction: Direction

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction."""
        return np.array(self.direction)

    def terms(self, view: View, p: Any) -> Terms:
        """See Target.terms."""
        return Terms(objective={"reach": -(p.T @ view.tip) / view.arm.length})


Objective = Literal["effort"] | Stiffest | Softest | Reach


def checked_objective(objective: Any, limits: Limits) -> Objective:
    """Return what a design makes best within limits, or raise InputError."""
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
