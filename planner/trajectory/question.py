"""What is asked of a motion, and a waypoint of its answer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from model.arm import Arm
from model.clearance.lines import Lines
from model.paths import Array
from model.scene import Scene
from planner.avoidance.asked import Surroundings
from planner.avoidance.rows import Avoidance
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.targets.base import Target
from planner.trajectory.asked import Rates

# Of the mesh of centrelines; what waypoints keep besides the clearance, over L, for the way
# between them.
_MESH, _SPARE = 3, 1e-3


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `share` is that of the time between two targets in which the arm goes there from the waypoint
    before, `plan` what was planned for it alone, if it was.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Avoidance | None
    share: float = 1.0
    plan: Plan | None = None

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        rows = self.avoidance is not None and bool(self.avoidance.rows)
        return (*self.targets, self.avoidance) if rows else self.targets  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of a motion.

    `start` are the tensions (n_tendons,) that it begins with [N], `begin` the plan they are of.
    """

    arm: Arm
    scene: Scene
    targets: tuple[tuple[Target, ...], ...]
    limits: Limits
    rates: Rates
    surroundings: Surroundings
    times: Array | None
    start: Array
    accuracy: float
    machine_code: bool = field(default=False, compare=False)
    begin: Plan | None = field(default=None, compare=False)

    @property
    def least(self) -> Array:
        """The least time to each target from the one before [s]: what is given, or none."""
        if self.times is None:
            return np.zeros(len(self.targets))
        return np.diff(self.times, prepend=0.0)

    @property
    def wider(self) -> Surroundings:
        """What waypoints are planned to keep clear of: by a little more than is asked."""
        asked = self.surroundings
        if not asked:
            return asked
        return replace(asked, clearance=asked.clearance + _SPARE * self.arm.length)

    def planned(
        self, targets: tuple[Target, ...], near: Plan | None, starts: int | None = None
    ) -> Plan:
        """Return the plan for targets by themselves, as clear of what stands still as waypoints."""
        return plan(
            self.arm,
            targets,
            self.scene,
            accuracy=self.accuracy,
            starts=starts,
            near=near,
            compile=self.machine_code,
            **self.limits.keywords,
            **self.wider.keywords,
        )

    def lines(self) -> Lines:
        """Return centrelines by tensions, under loads each near the one before."""
        places = tuple(Avoidance(()).stations(self.arm))
        return Lines(self.arm, self.scene, _MESH, places, self.machine_code)
