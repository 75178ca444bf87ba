"""What a design makes best, while all tasks are met: effort, a stiffness, or a reach.

A stiffness is told by the compliance c = d . C d at the tip. Its derivative by a number is a mixed
one of the tip's place: by a force along d and by the number. Exact derivatives by the numbers are
taken at a small force to either side; their difference is good to 1e-7 or so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from model import InputError
from model.checks import finite_array
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.newton import newton
from model.equilibrium.sensitivities import Sensitivities
from model.errors import SingularError
from model.paths import Array
from model.transcription.layout import POSE
from planner.targets import Softest, Stiffest

# How far the tip is pushed for a difference, over the arm's length.
_PUSHED = 1e-4


@dataclass(frozen=True)
class Reach:
    """The farthest place of the tip along a direction (3,), base frame, within the tension limits.

    By tensions of its own, beside those of the tasks.
    """

    direction: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", _unit("Reach.direction", self.direction))


Objective = Literal["effort"] | Stiffest | Softest | Reach


class Slopes(NamedTuple):
    """A quantity of a shape, its derivatives by the unknowns (K,) and by tensions (n_tendons,)."""

    value: float
    by_numbers: Array
    by_tensions: Array


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


def tip_along(by: ByNumbers, direction: Array) -> Slopes:
    """Return how far the tip is along a direction [m]."""
    places = by.here.system.of.nodes[-1, 4:POSE]
    rows = by.states[places], by.here.by_tensions[places]
    return Slopes(float(direction @ by.here.states[places]), *(direction @ own for own in rows))


def tip_compliance(by: ByNumbers, direction: Array) -> Slopes:
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
    return Slopes(c, *rows)


def _unit(name: str, direction: Any) -> tuple[float, ...]:
    given = finite_array(name, direction, (3,))
    size = float(np.linalg.norm(given))
    if not size > 0:
        raise InputError(name, direction, "a vector, not 0")
    return tuple((given / size).tolist())
