"""Tensions for given tendon lengths: minimum energy, then Newton's method.

The minimum of the energy subject to the lengths selects the taut tendons and gives approximate
tensions; see octoplan.model.extensions.lengths.least_energy. Newton's method then solves, to
rounding and with the tendon lengths l(T) of the equilibrium under tensions T,

    length + stretch T - l(T) = 0 for taut tendons,
    T = 0 and length - l(T) > 0 for slack tendons.

Steps have least norm in combinations of tensions that do not change lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap, transfer_strains
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium
from octoplan.model.equilibrium.newton import CHORD_RADIUS, STAGES, Start, newton
from octoplan.model.extensions.lengths.least_energy import ROUNDS, LeastEnergy
from octoplan.model.extensions.lengths.shortest import SHORT, no_shape, refuse
from octoplan.model.extensions.lengths.winches import ROUNDING, Winches, nonnegative_step, slackened
from octoplan.model.forward import ForwardMap, ForwardMaps
from octoplan.model.loads import has_complementarity, is_coupled
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.discrete_rod import DiscreteRod, system
from octoplan.model.support.errors import (
    CollapsedError,
    SnapError,
    UnsettledContactError,
    UnsettledSectionError,
)
from octoplan.model.support.progress import check_time
from octoplan.model.tendons import Lengths, tendon_lengths

# Number of stages of the elements for the minimum of the energy.
_STAGES = 2
# Largest number of Newton steps.
_STEPS = 30
# Relative change of the tensions at which Newton's method ends.
_LAST = 1e-6
# Predicted error after a step, over rounding, at which Newton's method ends; errors decrease
# quadratically.
_SQUARE = 0.1
# Smallest fraction of a Newton step, and of the path from initial to given lengths.
_LEAST_STEP = 1 / 64

# An equilibrium under tensions, with tendon lengths and their derivatives by tensions.
_At = TypeVar("_At", Equilibrium, Lengths)


def solve_lengths(
    at: _At,
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float = ROUNDING,
) -> _At | None:
    """Solve for the equilibrium whose taut tendons have the winches' lengths, by Newton's method.

    `rounding` is the tolerance over the arm's length. Combinations of tensions that change lengths
    by less have least norm. Newton steps without equilibrium, and steps that increase the error of
    the lengths, are halved. If rounding errors prevent convergence, return the equilibrium with the
    smallest error; return None if no equilibrium has the lengths approximately.
    """
    held = winches.held
    rounding = rounding * arm.length
    last = 0.0

    def missed_by(there: _At) -> float:
        T = there.tensions
        slack = winches.slack_lengths(there.lengths, T)
        return float(np.where(T > 0, np.abs(slack), -slack)[held].max(initial=0.0))

    nearly = SAME * arm.length
    best = None
    least_missed = np.inf
    # The error of the first step is not bounded: it may change combinations of tensions with hardly
    # any effect on lengths.
    missed = np.inf
    for _ in range(_STEPS):
        check_time()
        now = at.tensions
        left = winches.slack_lengths(at.lengths, at.tensions)
        level = max(nearly, 2 * float(np.abs(left[held & (now > 0)]).max(initial=0.0)))
        tight = np.flatnonzero(held & ((now > 0) | (left <= level)))
        M = np.diag(winches.stretch[tight]) - at.length_tension[np.ix_(tight, tight)]
        change = np.zeros(now.size)
        result, well = nonnegative_step(M, left[tight], now[tight], rounding)
        change[tight] = result - now[tight]
        size = float(np.abs(change).max())
        off = float(np.abs(left[tight]).max(initial=0.0))
        ratio = size / last if last else np.inf
        share = 1.0
        after = None
        most = max(missed, nearly)
        while (after is None or missed > most) and share >= _LEAST_STEP and np.isfinite(size):
            after = beside(at, now + share * change)
            share = share / 2
            missed = np.inf if after is None else missed_by(after)
        if after is None or missed > most:
            return best
        if missed <= nearly:
            last_step = well and size <= _LAST * after.tensions.max()
            if last_step or off * ratio * ratio <= _SQUARE * rounding:
                return after
            if last and missed < least_missed:
                best = after
                least_missed = missed
        at = after
        last = size
    return best


def continue_to_lengths(
    begins: Iterable[_At | None],
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float,
) -> _At | None:
    """Continue an initial equilibrium to the winches' lengths, in one step or in several.

    Steps are halved if they fail. If steps become too short, the branch ends, and the next initial
    equilibrium is used. Return None if all initial equilibria fail.
    """
    for begin in begins:
        at = begin
        reached = 0.0
        step = 1.0
        while at is not None and begin is not None and step >= _LEAST_STEP:
            share = min(reached + step, 1.0)
            spare = np.maximum(begin.lengths - winches.lengths, 0.0)
            held = replace(winches, lengths=winches.lengths + (1 - share) * spare)
            after = solve_lengths(at, held, beside, arm, rounding)
            if after is None:
                step /= 2
                continue
            if share == 1:
                return after
            at = after
            reached = share
            step = 2 * step
    return None


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, for some tendons or all.

    Attributes
    ----------
    maps : ForwardMaps
        Forward maps of the arm in the scene.
    winches : Winches
    near : (n_tendons,)
        Initial guess of the tensions.
    """

    maps: ForwardMaps
    winches: Winches
    near: Array | None = None

    def on(self, forward: ForwardMap, near: AnyEquilibrium | None) -> AnyEquilibrium:
        """Solve on the mesh of a forward map, warm-started from another equilibrium if given.

        Raises InputError if no shape has the lengths.
        """
        if not is_coupled(self.maps.arm, self.maps.scene):
            return forward.solve(self._unloaded_tensions)
        assert isinstance(forward, CollocationMap)
        begins = self._initial_equilibria(forward, near)
        result = continue_to_lengths(begins, self.winches, forward.solve_from, self.maps.arm, SAME)
        if result is None:
            raise no_shape(self.maps.arm, self.winches)
        return result

    def finished(self, forward: ForwardMap, end: AnyEquilibrium) -> AnyEquilibrium:
        """Return an accepted equilibrium with tensions refined to rounding if possible."""
        if not (isinstance(end, Equilibrium) and is_coupled(self.maps.arm, self.maps.scene)):
            return end
        assert isinstance(forward, CollocationMap)
        return solve_lengths(end, self.winches, forward.solve_from, self.maps.arm) or end

    def _initial_equilibria(
        self, forward: CollocationMap, near: AnyEquilibrium | None
    ) -> Iterator[Equilibrium | None]:
        """Yield initial equilibria, in the order of trial.

        The equilibrium near the one of another mesh, the ones under the tensions of minimum energy,
        and the one under the given tensions with all winches slack.
        """
        winches = self.winches
        touching = has_complementarity(self.maps.scene)
        if isinstance(near, Equilibrium):
            T = np.where(winches.held, near.tensions, winches.tensions)
            if touching:
                yield forward.solve(T, near)
            else:
                start = Start(T, 1.0, forward.transfer_states(T[None], [near])[0])
                yield from newton(forward.system, [start], CHORD_RADIUS)
        for coarse, T, v in self._least_energy():
            if touching:
                with suppress(SnapError, UnsettledContactError):
                    yield forward.solve(T)
            else:
                strains = transfer_strains(coarse, v, forward.system)
                start = Start(T, 1.0, forward.system.initial_states(T, strains, 1.0))
                yield from newton(forward.system, [start])
        with suppress(SnapError, UnsettledContactError, UnsettledSectionError):
            yield forward.solve(winches.tensions)

    @cached_property
    def _unloaded_tensions(self) -> Array:
        """Tensions of the arm without loads, which do not depend on a mesh.

        Raises CollapsedError if steps towards the lengths crush the arm.
        """
        winches = self.winches
        arm = self.maps.arm
        lengths = tendon_lengths(arm, self.maps.scene, self.maps.machine_code)
        crushed: list[CollapsedError] = []

        def under(_: Lengths | None, tensions: Array) -> Lengths | None:
            with suppress(UnsettledSectionError):
                result = lengths(tensions)
                if result.crushed is None:
                    return result
                crushed.append(result.crushed)
            return None

        def begins() -> Iterator[Lengths | None]:
            if self.near is not None:
                yield under(None, np.where(winches.held, self.near, winches.tensions))
            for _, tensions, _ in self._least_energy():
                yield under(None, tensions)
            yield slack

        slack = under(None, winches.tensions)
        if slack is not None:
            left = winches.slack_lengths(slack.lengths, slack.tensions)[winches.held]
            if left.min(initial=0.0) >= -ROUNDING * arm.length:
                return winches.tensions
        result = continue_to_lengths(begins(), winches, under, arm, ROUNDING)
        if result is None:
            raise crushed[-1] if crushed else no_shape(arm, winches)
        return result.tensions

    def _least_energy(self) -> Iterator[tuple[DiscreteRod, Array, Array]]:
        """Yield systems, tensions [N] and strains of minimum energy from rest, on a coarse mesh.

        Tensions (n_tendons,) of slack tendons are 0; strains are at the stages of the system. The
        first minimum neglects forces without a potential; for the second one, these forces are
        updated until they converge. Raises InputError if no shape has the lengths, with the tendon
        of the largest error.
        """
        arm = self.maps.arm
        scene = self.maps.scene
        winches = self.winches
        mesh = 1, (), is_coupled(arm, scene), self.maps.machine_code
        program = LeastEnergy(system(arm, scene, _STAGES, *mesh))
        for rounds in (1,) if program.conservative else (1, ROUNDS):
            minimum = program.minimise(program.at_rest(), winches.tensions, 1.0, winches, rounds)
            left = np.zeros(arm.n_tendons)
            is_short = minimum is None
            if minimum is not None:
                left = winches.slack_lengths(program.lengths(minimum), minimum.tensions)
                is_short = left[winches.held].min(initial=0.0) < -SHORT * arm.length
            if is_short and program.conservative:
                refuse(LeastEnergy(system(arm, scene, STAGES, *mesh)), winches)
            if minimum is not None:
                tensions = slackened(minimum.tensions, left, winches, arm)
                yield program.system, tensions, program.strains(minimum)
