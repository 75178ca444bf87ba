"""Continuation of equilibria along straight lines of tensions and load factor, or of the loads.

A step predicts the states to second order, from the tangents at the last two equilibria, and
corrects them by Newton's method. The poses are integrated from the predicted strains: the tangent
of a pose is accurate for small rotations only, and a slender tip rolls up by several turns. Many
branches are continued side by side, because they share the calls of the kernels.

If the loads change, such as for a payload that a bent arm picks up, the parameters of the equations
change along a straight line from the old loads to the new loads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import (
    CHORD_RADIUS,
    MAX_BRANCH_ROTATION,
    MAX_STEP_ROTATION,
    Start,
    newton,
)
from octoplan.model.equilibrium.stability import are_stable, is_stable
from octoplan.model.loads import with_loads_of
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import CollapsedError, UnsettledSectionError
from octoplan.model.support.progress import check_time, report

# The smallest step is LEAST_STEP times the fraction that is reached, and LEAST_STEP^2 at the start.
LEAST_STEP = 1 / 8192
# The same if the place at which a branch ends is not needed.
ROUGH_STEP = 1 / 32
# Smallest step of the loads, as a fraction of the whole change.
_LEAST_LOAD_STEP = 1 / 1024
# Largest factor of the tolerance of Newton's method for intermediate equilibria.
MAX_TOLERANCE_FACTOR = 1e6
# Number of rounds after which tensions are checked for a tendon without length: any load moves such
# a tendon by many times the smoothing width of the length, so that steps shrink without end.
_ROUNDS_BEFORE_CRUSHED = 30
# Reason for the end of a branch: no equilibrium is nearby.
SNAPS = "it snaps or folds"
# Reason for the end of a branch: the equilibrium is unstable.
BUCKLES = "it buckles"

# Returns the error if the tensions at the end of a line crush the arm without loads.
CrushedCheck = Callable[[], CollapsedError | UnsettledSectionError | None]


class BranchEnd(NamedTuple):
    """The last equilibrium on a branch.

    Attributes
    ----------
    point : Equilibrium
    fraction : float
        The fraction of the line that is reached.
    why : str
        The event beyond this fraction; empty at the end of the line.
    """

    point: Equilibrium
    fraction: float
    why: str = ""


def continue_branches(
    starts: Sequence[BranchEnd],
    lines: tuple[Array, Array],
    min_step: float,
    crushed: Sequence[CrushedCheck] = (),
    tolerance_factor: float = 1.0,
    path_tolerance_factor: float = 1.0,
    first_step: float = 1.0,
    visited: list[Equilibrium] | None = None,
) -> list[BranchEnd]:
    """Follow branches of equilibria of one system along lines of tensions and load factor.

    A step is shortened if the tangent rotates a frame too far, and halved if no stable equilibrium
    is nearby. A branch ends if the step falls below `min_step` times the fraction that is
    reached.

    Parameters
    ----------
    starts : sequence of BranchEnd
    lines : (M, n_tendons + 1), (M, n_tendons + 1)
        Tensions [N] and load factor at the fractions 0 and 1.
    min_step, first_step : float
        Smallest step relative to the fraction that is reached, and the first step.
    crushed : sequence of callable
        Checks of the tensions at the end of each line. A branch of crushing tensions ends early.
    tolerance_factor, path_tolerance_factor : float
        Factors of the tolerance of Newton's method at the end of the line and before; see Start.
    visited : list of Equilibrium
        Receives the equilibrium of each step of all branches.
    """
    system = starts[0].point.system
    branches = [
        _Branch(
            start=start,
            end=start,
            begin=begin,
            goal=goal,
            step=first_step,
            tolerance_factor=tolerance_factor,
            path_tolerance_factor=path_tolerance_factor,
            crushed=crushed[i] if crushed else None,
        )
        for i, (start, begin, goal) in enumerate(zip(starts, *lines, strict=True))
    ]
    active = branches
    rounds = 0
    while active:
        check_time()
        is_late = rounds == _ROUNDS_BEFORE_CRUSHED
        predicted = [(each, each.predict(min_step, is_late)) for each in active]
        active = [each for each, guess in predicted if guess is not None]
        guesses = [guess for _, guess in predicted if guess is not None]
        if not active:
            break
        if rounds:
            percent = round(100 * min(each.fraction for each in branches))
            report("percent of tensions and loads", percent, 100)
        rounds += 1
        points = [
            point if point is None or each.is_near(point) else None
            for each, point in zip(active, newton(system, guesses), strict=True)
        ]
        for each, point, stable in zip(active, points, are_stable(points), strict=True):
            is_accepted = each.correct(point, bool(stable))
            if is_accepted and point is not None and visited is not None:
                # Drop the factors: a hundred factorisations take many megabytes.
                visited.append(Equilibrium(system, point.x, history=point.history))
    return [each.end for each in branches]


@dataclass(eq=False)
class _Branch:
    """A branch that is being followed.

    Attributes
    ----------
    start, end : BranchEnd
        The first and the last equilibrium.
    begin, goal : (n_tendons + 1,)
        Tensions [N] and load factor at the fractions 0 and 1.
    step : float
        The next step, as a fraction of the line.
    tolerance_factor, path_tolerance_factor : float
        Factors of the tolerance of Newton's method at the end of the line and before.
    crushed : callable or None
        Check of the tensions at the end of the line.
    fraction : float
        The fraction of the last prediction.
    start_is_stable : bool or None
        Whether the first equilibrium is stable; None until it is needed.
    tangent : (Equilibrium, float, Array) or None
        The last equilibrium of a prediction, its fraction, and the derivative of its states by the
        fraction.
    tangent_before : (Equilibrium, float, Array) or None
        The same for the equilibrium before.
    """

    start: BranchEnd
    end: BranchEnd
    begin: Array
    goal: Array
    step: float
    tolerance_factor: float
    path_tolerance_factor: float
    crushed: CrushedCheck | None
    fraction: float = 0.0
    start_is_stable: bool | None = None
    tangent: tuple[Equilibrium, float, Array] | None = None
    tangent_before: tuple[Equilibrium, float, Array] | None = None

    def predict(self, min_step: float, is_late: bool) -> Start | None:
        """Return the guess of the next equilibrium; None if the branch ends.

        With `is_late`, a branch of crushing tensions ends.
        """
        point, reached, _ = self.end
        self.step = min(self.step, 1.0 - reached)
        if self.step <= 0 or self.step < min_step * max(reached, min_step):
            return None
        if is_late and self.crushed is not None and self.crushed():
            return None
        if point.factor is None:
            self.end = self.end._replace(why=BUCKLES)
            return None
        layout = point.system.layout
        if self.tangent is None or self.tangent[0] is not point:
            rate = point.by_direction(self.goal - self.begin)
            self.tangent_before = self.tangent
            self.tangent = point, reached, rate
        rate = self.tangent[2]
        rotation = 2 * self.step * float(np.abs(rate[layout.nodes[:, :4]]).max())
        step = self.step * min(1.0, MAX_STEP_ROTATION / max(rotation, MAX_STEP_ROTATION))
        if step < min_step * max(reached, min_step):
            self.end = self.end._replace(why=SNAPS)
            return None
        # Reach the end of the line to the last digit in spite of rounding.
        self.fraction = 1.0 if step == 1.0 - reached else reached + step
        at = self.begin + self.fraction * (self.goal - self.begin)
        is_last = self.fraction == 1.0
        return Start(
            at[: layout.n_tendons],
            float(at[layout.n_tendons]),
            self.predicted_states(),
            tolerance_factor=self.tolerance_factor if is_last else self.path_tolerance_factor,
            history=point.history,
        )

    def predicted_states(self) -> Array:
        """Return the states (n_states,) at the fraction of the prediction, to second order.

        If the step is longer than the last step, the change of the tangent is that of the last
        step: extrapolation further than that is unreliable near folds.
        """
        assert self.tangent is not None
        point, reached, rate = self.tangent
        step = self.fraction - reached
        states = point.states + step * rate
        if self.tangent_before is not None:
            _, before, rate_before = self.tangent_before
            last_step = reached - before
            states += step * min(step / last_step, 1.0) / 2 * (rate - rate_before)
        return with_poses(point.system, states)

    def is_near(self, point: Equilibrium) -> bool:
        """Return whether all frames rotate less than the limit from the last equilibrium."""
        quaternions = point.system.layout.nodes[:, :4]
        products = self.end.point.states[quaternions] * point.states[quaternions]
        cosine = float(np.abs(products.sum(axis=1)).min())
        return cosine > float(np.cos(MAX_BRANCH_ROTATION / 2))

    def correct(self, point: Equilibrium | None, stable: bool) -> bool:
        """Accept the equilibrium of a step, or halve the step; return whether it was accepted."""
        if point is not None and not stable and self.start_is_stable is None:
            # An instability that exists at the start does not end the branch.
            self.start_is_stable = is_stable(self.start.point)
        if point is None or (not stable and self.start_is_stable):
            self.end = self.end._replace(why=SNAPS if point is None else BUCKLES)
            self.step = (self.fraction - self.end.fraction) / 2
            self.path_tolerance_factor = 1.0
            return False
        self.end = BranchEnd(point, self.fraction)
        self.step *= 2
        return True


def with_poses(system: DiscreteRod, states: Array) -> Array:
    """Return states (n_states,) whose poses are integrated from their strains."""
    result = states.copy()
    layout = system.layout
    result[layout.nodes[:, :POSE]] = system.integrate_poses(states[layout.stages])
    return result


def change_loads(system: DiscreteRod, begin: Equilibrium, strains: Array) -> Equilibrium | None:
    """Return the equilibrium under the loads of a system, on the branch of an equilibrium.

    Parameters
    ----------
    system : DiscreteRod
        The equations with the new loads.
    begin : Equilibrium
        The equilibrium under the old loads; tensions are constant.
    strains : (N stages, strains)
        The strains of `begin` at the stages of the system.

    Returns
    -------
    Equilibrium or None
        None if the branch ends because the arm snaps, folds or buckles, or if the scenes differ in
        more than the loads.
    """
    scene = with_loads_of(system.scene, begin.system.scene)
    if scene is None:
        return None
    before = system.on_mesh(system.mesh, scene)
    if before.layout is not system.layout:
        return None
    states = before.initial_states(begin.tensions, strains, 1.0)
    (point,) = newton(before, [Start(begin.tensions, 1.0, states, history="near")], CHORD_RADIUS)
    change = system.p - before.p
    fraction = 0.0
    step = 1.0
    while point is not None and fraction < 1 and step >= _LEAST_LOAD_STEP:
        check_time()
        step = min(step, 1 - fraction)
        after = copy(system)
        after.p = before.p + (fraction + step) * change
        guess = point.states - point.solve(after.residual(point.x))
        (there,) = newton(after, [Start(begin.tensions, 1.0, guess, history="near")])
        if there is None or not is_stable(there):
            step /= 2
            continue
        point = there
        fraction += step
        step *= 2
    return point if fraction == 1 else None
