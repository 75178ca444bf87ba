"""What a design is held to and what it makes best: limits of making, and objectives.

A stiffness is told by the compliance c = d . C d at the tip. Its derivative by a number is a mixed
one of the tip's place: by a force along d and by the number. Exact derivatives by the numbers are
taken at a small force to either side; their difference is good to 1e-7 or so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from model import Arm, InputError
from model.checks import finite_array, not_negative
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.newton import newton
from model.equilibrium.sensitivities import Sensitivities
from model.errors import SingularError
from model.paths import Array
from model.transcription.layout import POSE
from planner.targets import Softest, Stiffest

_STATIONS = 9
# Room, over an arm's length, that is none.
_NONE = 1e-6
# How far the tip is pushed for a difference, over the arm's length.
_PUSHED = 1e-4


@dataclass(frozen=True)
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

    wall: float = 0.0
    radius: float = 0.0
    spacing: float = 0.0

    def __post_init__(self) -> None:
        for name in ("wall", "radius", "spacing"):
            object.__setattr__(self, name, not_negative(f"Making.{name}", getattr(self, name)))

    def binding(self, arm: Arm) -> tuple[str, ...]:
        """Return what an arm has no room left of, in words; only of limits that were given."""
        names = [(f"radius {1e3 * self.radius:g} mm", self.radius)] * _STATIONS
        names += [(f"wall {1e3 * self.wall:g} mm", self.wall)] * _STATIONS * len(arm.offset_paths)
        names += [(f"spacing {1e3 * self.spacing:g} mm", self.spacing)] * len(arm.sections)
        rows = zip(names, self.room(arm), strict=False)
        return tuple(dict.fromkeys(name for (name, limit), room in rows if limit and room < _NONE))

    def room(self, arm: Arm) -> Array:
        """Return what is left of each limit over the arm's length (n,): 0 or above can be made."""
        share = np.linspace(0.0, 1.0, _STATIONS)
        rows = [arm.radius.evaluate(share * arm.length, arm.length)[0] - self.radius]
        for i, path in arm.offset_paths:
            end = arm.sections[i].at
            y = np.abs(path.evaluate(share * end, end)[0])
            surface = (arm.hull or arm.radius).evaluate(share * end, arm.length)[0]
            rows.append(surface - y - self.wall)
        ends = np.array([*arm.anchorages, 0.0])
        rows += [-np.diff(ends) - self.spacing, np.array([arm.length - ends[0]])]
        return np.concatenate(rows) / arm.length


@dataclass(frozen=True)
class Reach:
    """The farthest place of the tip along a direction (3,), base frame, within the tension limits.

    By tensions of its own, beside those of the tasks.
    """

    direction: tuple[float, ...]

    def __post_init__(self) -> None:
        given = finite_array("Reach.direction", self.direction, (3,))
        size = float(np.linalg.norm(given))
        if not size > 0:
            raise InputError("Reach.direction", self.direction, "a vector, not 0")
        object.__setattr__(self, "direction", tuple((given / size).tolist()))


Objective = Literal["effort"] | Stiffest | Softest | Reach


def checked_objective(given: Any) -> Objective:
    """Return what a design makes best, or raise InputError."""
    if given == "effort" or isinstance(given, Reach):
        return given  # type: ignore[no-any-return]
    if not isinstance(given, Stiffest | Softest):
        allowed = '"effort", Stiffest(direction), Softest(direction) or Reach(direction)'
        raise InputError("objective", given, allowed)
    if given.hold != "tension":
        raise InputError("objective", given, 'hold="tension": a stiffness with tensions held')
    return given


class Gradient(NamedTuple):
    """A quantity of a shape, its derivatives by the unknowns (K,) and by tensions (n_tendons,)."""

    value: float
    by_numbers: Array
    by_tensions: Array


def tip_along(by: ByNumbers, direction: Array) -> Gradient:
    """Return how far the tip is along a direction [m]."""
    places = by.here.system.of.nodes[-1, 4:POSE]
    rows = by.states[places], by.here.by_tensions[places]
    return Gradient(float(direction @ by.here.states[places]), *(direction @ own for own in rows))


def tip_compliance(by: ByNumbers, direction: Array) -> Gradient:
    """Return the compliance of the tip along a direction [m/N], tensions held."""
    here, system = by.here, by.here.system
    answer = Sensitivities(here, system.mesh.steps).pose_wrench
    c = float(direction @ answer[:3, :3] @ direction)
    size, ends = _PUSHED * system.arm.length / c, []
    for force in (size * direction, -size * direction):
        pushed = newton(system.pushed(force), here.tensions, 1.0, here.states, kept=here)
        if pushed is None:
            raise SingularError("the tip yields to a small force")
        ends.append(tip_along(ByNumbers(pushed.refreshed, by.jacobian, by.tensions), direction))
    one, other = ends
    rows = [(a - b) / (2 * size) for a, b in zip(one[1:], other[1:], strict=True)]
    return Gradient(c, *rows)
