"""Tensions by the lengths that winches leave: the least energy, then Newton's method.

The minimum of the energy under rows of lengths tells which tendons are taut, and about how hard
they pull; see octoplan.model.extensions.lengths.least_energy. With the lengths of the equilibrium
as a function of the tensions, l(T), those of taut tendons are then found to rounding:

    length + stretch T - l(T) = 0 of taut tendons, T = 0 and length - l(T) > 0 of slack ones,

by Newton steps, of least norm in combinations of tensions that no length feels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium
from octoplan.model.equilibrium.load_steps import Collocation, carried_strains
from octoplan.model.equilibrium.newton import CLOSE, STAGES, Start, newton
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.lengths.least_energy import ROUNDS, LeastEnergy
from octoplan.model.extensions.lengths.shortest import SHORT, no_shape, refuse
from octoplan.model.extensions.lengths.winches import ROUNDING, Winches, least, slackened
from octoplan.model.forward import ForwardMap, ForwardMaps
from octoplan.model.loads import is_loaded
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.system import DiscreteRod, system
from octoplan.model.support.errors import (
    CollapsedError,
    SnapError,
    UnsettledContactError,
    UnsettledSectionError,
)
from octoplan.model.support.progress import check_time
from octoplan.model.unloaded.marched import Lengths, tendon_lengths

# Stages of the elements on which the least energy is sought.
_STAGES = 2
# Newton steps; that one is the last which changes tensions by no more than this share, or which
# will leave no more than this share of rounding, as its error goes by the square.
_STEPS, _LAST, _SQUARE = 30, 1e-6, 0.1
# The least step towards the lengths, as a share of the whole way, and of a Newton step.
_LEAST_STEP = 1 / 64

# An equilibrium under tensions whose lengths, and how these change with tensions, are known.
_At = TypeVar("_At", Equilibrium, Lengths)


def tightened(
    at: _At,
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float = ROUNDING,
) -> _At | None:
    """Return the equilibrium whose taut tendons are as long as winches leave them, to `rounding`.

    Over the arm's length; combinations of tensions that lengths feel by less are the least. Where
    rounding keeps the steps from ending it is the equilibrium that misses lengths least; None where
    lengths are not met at all. Newton steps that lead to no equilibrium, or to one that misses
    lengths by more, are halved.
    """
    held, rounding, last = winches.held, rounding * arm.length, 0.0

    def missed_by(there: _At) -> float:
        T = there.tensions
        slack = winches.slack_lengths(there.lengths, T)
        return float(np.where(T > 0, np.abs(slack), -slack)[held].max(initial=0.0))

    nearly, best, least_missed = SAME * arm.length, None, np.inf
    # The first step goes to combinations that are hardly felt, from what is met already.
    missed = np.inf
    for _ in range(_STEPS):
        check_time()
        now, left = at.tensions, winches.slack_lengths(at.lengths, at.tensions)
        level = max(nearly, 2 * float(np.abs(left[held & (now > 0)]).max(initial=0.0)))
        tight = np.flatnonzero(held & ((now > 0) | (left <= level)))
        M = np.diag(winches.stretch[tight]) - at.length_tension[np.ix_(tight, tight)]
        change = np.zeros(now.size)
        result, well = least(M, left[tight], now[tight], rounding)
        change[tight] = result - now[tight]
        size, off = float(np.abs(change).max()), float(np.abs(left[tight]).max(initial=0.0))
        ratio, share, after = size / last if last else np.inf, 1.0, None
        most = max(missed, nearly)
        while (after is None or missed > most) and share >= _LEAST_STEP and np.isfinite(size):
            after, share = beside(at, now + share * change), share / 2
            missed = np.inf if after is None else missed_by(after)
        if after is None or missed > most:
            return best
        if missed <= nearly:
            last_step = well and size <= _LAST * after.tensions.max()
            if last_step or off * ratio * ratio <= _SQUARE * rounding:
                return after
            if last and missed < least_missed:
                best, least_missed = after, missed
        at, last = after, size
    return best


def taken_in(
    begins: Iterable[_At | None],
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float,
) -> _At | None:
    """Return the equilibrium at lengths that winches take in, from those of the first that may be.

    At once if they can, else step by step. Of equilibria to begin with the next is taken where
    steps become short: there is none farther on along the branch. None where that was the last.
    """
    for begin in begins:
        at, reached, step = begin, 0.0, 1.0
        while at is not None and begin is not None and step >= _LEAST_STEP:
            share = min(reached + step, 1.0)
            spare = np.maximum(begin.lengths - winches.lengths, 0.0)
            held = replace(winches, lengths=winches.lengths + (1 - share) * spare)
            after = tightened(at, held, beside, arm, rounding)
            if after is None:
                step /= 2
                continue
            if share == 1:
                return after
            at, reached, step = after, share, 2 * step
    return None


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, of some tendons or all.

    Attributes
    ----------
    maps : ForwardMaps
        The forward maps of the arm in its scene.
    near : (n_tendons,)
        Tensions to begin with.
    """

    maps: ForwardMaps
    winches: Winches
    near: Array | None = None

    def on(self, forward: ForwardMap, near: AnyEquilibrium | None) -> AnyEquilibrium:
        """Return the equilibrium on the mesh of a forward map, near that of another if given.

        Raises InputError where no shape has the lengths.
        """
        if not is_loaded(self.maps.scene):
            return forward.solve(self._unloaded_tensions)
        assert isinstance(forward, Collocation)
        begins = self._initial_equilibria(forward, near)
        result = taken_in(begins, self.winches, forward.led_to, self.maps.arm, SAME)
        if result is None:
            raise no_shape(self.maps.arm, self.winches)
        return result

    def finished(self, forward: ForwardMap, end: AnyEquilibrium) -> AnyEquilibrium:
        """Return an accepted equilibrium with tensions to rounding, itself where none are found."""
        if not (isinstance(end, Equilibrium) and is_loaded(self.maps.scene)):
            return end
        assert isinstance(forward, Collocation)
        return tightened(end, self.winches, forward.led_to, self.maps.arm) or end

    def _initial_equilibria(
        self, forward: Collocation, near: AnyEquilibrium | None
    ) -> Iterator[Equilibrium | None]:
        """Yield equilibria to begin with: near that of another mesh, at the tensions of the least
        energy, at those that no winch holds.
        """
        winches, touching = self.winches, isinstance(forward, TouchingMap)
        if isinstance(near, Equilibrium):
            T = np.where(winches.held, near.tensions, winches.tensions)
            if touching:
                yield forward.solve(T, near)
            else:
                start = Start(T, 1.0, forward.carried(T[None], [near])[0])
                yield from newton(forward.system, [start], CLOSE)
        for coarse, T, v in self._least_energy():
            if touching:
                with suppress(SnapError, UnsettledContactError):
                    yield forward.solve(T)
            else:
                strains = carried_strains(coarse, v, forward.system)
                start = Start(T, 1.0, forward.system.start(T, strains, 1.0))
                yield from newton(forward.system, [start])
        with suppress(SnapError, UnsettledContactError, UnsettledSectionError):
            yield forward.solve(winches.tensions)

    @cached_property
    def _unloaded_tensions(self) -> Array:
        """Tensions of the arm without loads, found once: no mesh is asked for.

        Raises CollapsedError where steps towards the lengths crush the arm.
        """
        winches, arm = self.winches, self.maps.arm
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
        result = taken_in(begins(), winches, under, arm, ROUNDING)
        if result is None:
            raise crushed[-1] if crushed else no_shape(arm, winches)
        return result.tensions

    def _least_energy(self) -> Iterator[tuple[DiscreteRod, Array, Array]]:
        """Yield tensions [N] and strains of the least energy from rest, on a coarse mesh.

        Tensions (n_tendons,) of slack tendons are 0; strains are at the stages of the system.
        Forces without a potential are left out at first; then they are updated until they stay.
        Raises InputError where no shape has the lengths, naming the tendon that is farthest from
        it.
        """
        arm, scene, winches = self.maps.arm, self.maps.scene, self.winches
        mesh = 1, (), is_loaded(scene), self.maps.machine_code
        program = LeastEnergy(system(arm, scene, _STAGES, *mesh))
        for rounds in (1,) if program.conservative else (1, ROUNDS):
            minimum = program.least(program.at_rest(), winches.tensions, 1.0, winches, rounds)
            left, is_short = np.zeros(arm.n_tendons), minimum is None
            if minimum is not None:
                left = winches.slack_lengths(program.lengths(minimum), minimum.tensions)
                is_short = left[winches.held].min(initial=0.0) < -SHORT * arm.length
            if is_short and program.conservative:
                refuse(LeastEnergy(system(arm, scene, STAGES, *mesh)), winches)
            if minimum is not None:
                tensions = slackened(minimum.tensions, left, winches, arm)
                yield program.system, tensions, program.strains(minimum)
