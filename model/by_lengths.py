"""Tensions by the lengths that winches leave: the least energy, then Newton's method.

The minimum of the energy under rows of lengths tells which tendons are taut, and about how hard
they pull; see model.least_energy. With the lengths of the equilibrium as a function of the
tensions, l(T), those of taut tendons are then found to rounding:

    length + stretch T - l(T) = 0 of taut tendons, T = 0 and length - l(T) > 0 of slack ones,

by Newton steps, of least norm in combinations of tensions that no length feels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Protocol, TypeVar

import numpy as np

from model.arm import Arm
from model.contact.forward import TouchingMap
from model.equilibrium.linearised import Equilibrium, Linearised
from model.equilibrium.newton import (
    CLOSE,
    STAGES,
    Collocation,
    carried_strains,
    newton,
    step_sizes,
)
from model.errors import CollapsedError, SnapError, UnsettledSectionError
from model.forward import ForwardMap
from model.least_energy import ROUNDS, LeastEnergy
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.shortest import SHORT, refuse, unknown_least
from model.time_limit import check_time
from model.transcription.system import System, system
from model.unloaded.marched import Lengths, tendon_lengths
from model.winches import ROUNDING, Winches, least, slackened

# Stages of the elements on which the least energy is sought.
_STAGES = 2
# Newton steps; that one is the last which changes tensions by no more than this share, or which
# will leave no more than this share of rounding, as its error goes by the square.
_STEPS, _LAST, _SQUARE = 30, 1e-5, 0.1
# What is left of tendons that are slack, and what taut ones may be off, over the arm's length; on
# meshes that are not the last one all.
_NEARLY = 1e-9
# The least step towards the lengths, as a share of the whole way.
_LEAST_STEP = 1 / 64
# How often a step is halved that leads to no equilibrium.
_HALVINGS = 6


class AtLengths(Protocol):
    """An equilibrium under tensions: what the lengths of its tendons are, and how they change."""

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""

    @property
    def lengths(self) -> Array:
        """The lengths (n_tendons,) [m]."""

    @property
    def length_tension(self) -> Array:
        """How these change with the tensions (n_tendons, n_tendons) [m/N]."""


_At = TypeVar("_At", bound=AtLengths)


def equilibrium_beside(at: Linearised, tensions: Array) -> Linearised | None:
    """Return the equilibrium under tensions near those of another; None where there is none."""
    change = at.by_tensions @ (tensions - at.tensions)
    is_close = step_sizes(at.system, change, at.states)[1] < CLOSE
    load, states = float(at.x[at.system.of.n_tendons]), at.states + change
    return newton(at.system, tensions, load, states, near=at if is_close else None)


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
    lengths are not met at all.
    """
    held, rounding, last = winches.held, rounding * arm.length, 0.0
    nearly, best, least_missed = _NEARLY * arm.length, None, np.inf
    for _ in range(_STEPS):
        check_time()
        now, left = at.tensions, winches.lacks(at.lengths, at.tensions)
        level = max(nearly, 2 * float(np.abs(left[held & (now > 0)]).max(initial=0.0)))
        tight = np.flatnonzero(held & ((now > 0) | (left <= level)))
        M = np.diag(winches.stretch[tight]) - at.length_tension[np.ix_(tight, tight)]
        T = now.copy()
        T[tight], well = least(M, left[tight], now[tight], rounding)
        change, off = float(np.abs(T - now).max()), float(np.abs(left[tight]).max(initial=0.0))
        ratio = change / last if last else np.inf
        small = (well and change <= _LAST * T.max()) or off * ratio * ratio <= _SQUARE * rounding
        after = _stepped(at, T, beside) if np.isfinite(T).all() else None
        if after is None:
            return best
        lacks = winches.lacks(after.lengths, T)
        missed = np.where(T > 0, np.abs(lacks), -lacks)[held].max(initial=0.0)
        if missed <= nearly:
            if small:
                return after
            # The first step goes to combinations that are hardly felt, from what is met already.
            if last and missed < least_missed:
                best, least_missed = after, missed
        at, last = after, change
    return best


def _stepped(at: _At, tensions: Array, beside: Callable[[_At, Array], _At | None]) -> _At | None:
    """Return the equilibrium that a step of the tensions, or a part of it, leads to."""
    for halved in range(_HALVINGS):
        result = beside(at, at.tensions + 0.5**halved * (tensions - at.tensions))
        if result is not None:
            return result
    return None


def taken_in(
    at: _At,
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float,
) -> _At | None:
    """Return the equilibrium at lengths that winches take in step by step, from those of another.

    None where steps become short: there is no equilibrium farther on along its branch.
    """
    spare, reached, step = np.maximum(at.lengths - winches.lengths, 0.0), 0.0, 1.0
    while reached < 1:
        share = min(reached + step, 1.0)
        held = replace(winches, lengths=winches.lengths + (1 - share) * spare)
        after = tightened(at, held, beside, arm, rounding if share == 1 else _NEARLY)
        if after is not None:
            at, reached, step = after, share, 2 * step
        elif step > _LEAST_STEP:
            step /= 2
        else:
            return None
    return at


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, of some tendons or all.

    Attributes
    ----------
    near : (n_tendons,)
        Tensions to begin with.
    """

    arm: Arm
    scene: Scene
    winches: Winches
    machine_code: bool = False
    near: Array | None = None

    def on(self, forward: ForwardMap, near: Equilibrium | None) -> Equilibrium:
        """Return the equilibrium on the mesh of a forward map, near that of another if given.

        Raises InputError where no shape has the lengths.
        """
        if not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            return forward.solve(self._unloaded)
        beside = _beside(forward)
        result = self._led(self._begins(forward, near), beside, _NEARLY)
        if result is None and not isinstance(forward, TouchingMap):
            with suppress(SnapError, UnsettledSectionError):
                at_rest = forward.from_rest(self.winches.tensions)
                result = taken_in(at_rest, self.winches, beside, self.arm, _NEARLY)
        if result is None:
            raise unknown_least(self.arm, self.winches)
        return result

    def finished(self, forward: ForwardMap, end: Equilibrium) -> Equilibrium:
        """Return an accepted equilibrium with tensions to rounding, itself where none are found."""
        if not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            return end
        assert isinstance(end, Linearised)
        return tightened(end, self.winches, _beside(forward), self.arm) or end

    def _begins(
        self, forward: Collocation, near: Equilibrium | None
    ) -> Iterator[Linearised | None]:
        """Yield equilibria to begin with: one near that of another mesh, then from rest."""
        if isinstance(near, Linearised):
            T = np.where(self.winches.held, near.tensions, self.winches.tensions)
            if isinstance(forward, TouchingMap):
                yield forward.solve(T, near)
            else:
                yield newton(forward.system, T, 1.0, forward.carried(T, near), CLOSE)
        if isinstance(forward, TouchingMap):
            yield forward.by_lengths(self.winches)
            return
        for coarse, T, v in self._least():
            strains = carried_strains(coarse, v, forward.system)
            yield newton(forward.system, T, 1.0, forward.system.start(T, strains, 1.0))

    @cached_property
    def _unloaded(self) -> Array:
        """Tensions of the arm without loads, found once: no mesh is asked for.

        Raises CollapsedError where steps towards the lengths crush the arm.
        """
        winches, lengths = self.winches, tendon_lengths(self.arm, self.scene, self.machine_code)
        crushed: list[CollapsedError] = []

        def beside(at: Lengths | None, tensions: Array) -> Lengths | None:
            with suppress(UnsettledSectionError):
                result = lengths(tensions)
                if result.crushed is None:
                    return result
                crushed.append(result.crushed)
            return None

        slack = beside(None, winches.tensions)
        if slack is not None:
            left = winches.lacks(slack.lengths, slack.tensions)[winches.held]
            if left.min() >= -ROUNDING * self.arm.length:
                return winches.tensions
        near = [] if self.near is None else [np.where(winches.held, self.near, winches.tensions)]
        begins = map(lengths, chain(near, (tensions for _, tensions, _ in self._least())))
        result = self._led(begins, beside, ROUNDING)
        if result is None and slack is not None:
            result = taken_in(slack, winches, beside, self.arm, ROUNDING)
        if result is None:
            raise crushed[-1] if crushed else unknown_least(self.arm, winches)
        return result.tensions

    def _led(
        self,
        begins: Iterable[_At | None],
        beside: Callable[[_At, Array], _At | None],
        rounding: float,
    ) -> _At | None:
        """Return the equilibrium near the first of some that have one near; None for none."""
        for begin in begins:
            result = begin and tightened(begin, self.winches, beside, self.arm, rounding)
            if result is not None:
                return result
        return None

    def _least(self) -> Iterator[tuple[System, Array, Array]]:
        """Yield tensions [N] and strains of the least energy from rest, on a coarse mesh.

        Tensions (n_tendons,) of slack tendons are 0; strains are at the stages of the system.
        Forces without a potential are left out at first; then they are updated until they stay.
        Raises InputError where no shape has the lengths, naming the tendon that is farthest from
        it.
        """
        arm, scene, winches = self.arm, self.scene, self.winches
        mesh = 1, (), is_loaded(scene), self.machine_code
        program = LeastEnergy(system(arm, scene, _STAGES, *mesh))
        for rounds in (1,) if program.conservative else (1, ROUNDS):
            minimum = program.least(program.at_rest(), winches.tensions, 1.0, winches, rounds)
            left, lacks = np.zeros(arm.n_tendons), minimum is None
            if minimum is not None:
                left = winches.lacks(program.lengths(minimum), minimum.tensions)
                lacks = left[winches.held].min(initial=0.0) < -SHORT * arm.length
            if lacks and program.conservative:
                refuse(LeastEnergy(system(arm, scene, STAGES, *mesh)), winches)
            if minimum is not None:
                tensions = slackened(minimum.tensions, left, winches, arm)
                yield program.system, tensions, program.strains(minimum)


def _beside(forward: Collocation) -> Callable[[Linearised, Array], Linearised | None]:
    """Return what leads from an equilibrium to that under tensions near its own."""
    return forward.beside if isinstance(forward, TouchingMap) else equilibrium_beside
