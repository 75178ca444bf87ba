"""Tensions by the lengths that winches leave: the least energy, then Newton's method.

The minimum of the energy under rows of lengths tells which tendons are taut, and about how hard
they pull; see model.least_energy.program. With the lengths of the equilibrium as a function of the
tensions, l(T), those of taut tendons are then found to rounding:

    length + stretch T - l(T) = 0 of taut tendons, T = 0 and length - l(T) > 0 of slack ones,

by Newton steps, of least norm in combinations of tensions that no length feels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import ROUNDING, least
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.errors import CollapsedError, UnsettledSectionError
from model.least_energy.program import STAGES, LeastEnergy, Minimum
from model.paths import Array
from model.scene import Scene
from model.shortest import refuse, unknown_least
from model.time_limit import check_time
from model.transcription.system import system
from model.unloaded.tendon_lengths import Lengths, tendon_lengths
from model.winches import Winches, arm_compliance

# Newton steps; that one is the last which changes tensions by no more than this share, or which
# will leave no more than this share of rounding, as its error goes by the square.
_STEPS, _LAST, _SQUARE = 30, 1e-5, 0.1
# What is left of taut tendons after a step, over rounding, where others keep them from it.
_APART = 10.0
# What is left of tendons that are slack, and what taut ones may be off, over the arm's length.
_NEARLY = 1e-9
# How often a step is halved that leads to no equilibrium, and the least step in what tendons lack.
_HALVINGS, _LEAST_STEP = 6, 1 / 128


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


def least_by_lengths(program: LeastEnergy, winches: Winches) -> Minimum | None:
    """Return the least energy by lengths, from rest; None where none is found.

    Raises InputError where no shape has the lengths, naming the tendon that is farthest from it.
    """
    found = program.least(program.at_rest(), winches.tensions, 1.0, winches, rounds=1)
    if found is None and program.conservative:
        refuse(program, winches)
    return found


def slackened(tensions: Array, left: Array, winches: Winches, arm: Arm) -> Array:
    """Return tensions of an interior point, 0 of tendons that have more left than they pull."""
    slack = winches.held & (arm_compliance(arm) * tensions < left)
    return np.where(slack, 0.0, tensions)


_At = TypeVar("_At", bound=AtLengths)


class UnloadedLengths:
    """The tensions of an arm without loads, whose cross-sections settle each by itself."""

    def __init__(self, arm: Arm, scene: Scene, winches: Winches, machine_code: bool) -> None:
        self._lengths, self.winches = tendon_lengths(arm, scene, machine_code), winches
        self._arm, self._system = arm, system(arm, scene, STAGES, 1, (), False, machine_code)
        self._crushed: CollapsedError | None = None

    def tensions(self, near: Array | None = None) -> Array:
        """Return the tensions (n_tendons,) [N], begun with some nearby; see settle.

        Raises CollapsedError where steps towards the lengths crush the arm.
        """
        arm, winches = self._arm, self.winches
        if not winches.tensions.any():
            left = winches.lacks(self._lengths(0 * winches.tensions).lengths, 0 * winches.tensions)
            if left[winches.held].min() >= -ROUNDING * arm.length:
                return 0 * winches.tensions
        if near is not None:
            T = np.where(winches.held, near, winches.tensions)
            found = tightened(self._lengths(T), winches, self._beside, arm)
            if found is not None:
                return found.tensions
        program, found = LeastEnergy(self._system), None
        least = least_by_lengths(program, winches)
        if least is not None:
            left = winches.lacks(program.lengths(least), least.tensions)
            T = slackened(least.tensions, left, winches, arm)
            found = tightened(self._lengths(T), winches, self._beside, arm)
        if found is None:
            found = followed(self._lengths(winches.tensions), winches, self._beside, arm)
        if found is None:
            raise self._crushed or unknown_least(arm, winches)
        return found.tensions

    def at(self, tensions: Array) -> Lengths:
        """Return the lengths of the tendons under tensions."""
        return self._lengths(tensions)

    def _beside(self, at: Lengths, tensions: Array) -> Lengths | None:
        try:
            found = self._lengths(tensions)
        except UnsettledSectionError:
            return None
        if found.crushed:
            self._crushed = found.crushed
            return None
        return found


def equilibrium_beside(at: Linearised, tensions: Array) -> Linearised | None:
    """Return the equilibrium under tensions near those of another; None where there is none."""
    states = at.states + at.by_tensions @ (tensions - at.tensions)
    return newton(at.system, tensions, float(at.x[at.system.of.n_tendons]), states)


def tightened(
    at: _At,
    winches: Winches,
    beside: Callable[[_At, Array], _At | None],
    arm: Arm,
    rounding: float = ROUNDING,
) -> _At | None:
    """Return the equilibrium whose taut tendons are as long as winches leave them, to `rounding`.

    Over the arm's length; combinations of tensions that lengths feel by less are the least. None
    where it takes too many steps. A tendon that has slackened is tight again only where
    nothing is left of it, but for what others lack so far; one that keeps taut ones from their
    lengths is not.
    """
    held, rounding = winches.held, rounding * arm.length
    close, last = max(_NEARLY * arm.length, _APART * rounding), 0.0
    nearly = np.full(at.tensions.size, _NEARLY * arm.length)
    for _ in range(_STEPS):
        check_time()
        now, left = at.tensions, winches.lacks(at.lengths, at.tensions)
        taut = now > 0
        level = 2 * np.abs(left[held & taut]).max(initial=0.0)
        limit = np.where(nearly > 0, np.maximum(nearly, level), -rounding)
        tight = np.flatnonzero(held & (taut | (left <= limit)))
        M = np.diag(winches.stretch[tight]) - at.length_tension[np.ix_(tight, tight)]
        T = now.copy()
        T[tight], well, whole = least(M, left[tight], now[tight], rounding)
        beyond = left[tight] + M @ (T - now)[tight]
        slack = (T[tight] == 0) & (beyond > rounding)
        apart = np.abs(beyond[T[tight] > 0]).max(initial=0.0) > _APART * rounding
        change, off = float(np.abs(T - now).max()), float(np.abs(left[tight]).max(initial=0.0))
        ratio = change / last if last else np.inf
        small = (well and change <= _LAST * T.max()) or off * ratio * ratio <= _SQUARE * rounding
        after = _stepped(at, T, beside) if np.isfinite(T).all() else None
        if after is None:
            return None
        if whole and small and not (apart and slack.any()):
            lacks = winches.lacks(after.lengths, T)
            missed = held & (lacks <= nearly)
            missed[tight] = np.abs(lacks[tight]) > np.where(T[tight] > 0, close, np.inf)
            if not missed.any():
                return after
        nearly[taut & (T == 0)], last = rounding, change
        if apart and whole:
            nearly[tight[slack]] = -rounding
        at = after
    return None


def followed(
    at: _At, winches: Winches, beside: Callable[[_At, Array], _At | None], arm: Arm
) -> _At | None:
    """Return the equilibrium by lengths that one with longer tendons is led to; None if to none.

    What its tendons lack shrinks in steps that are halved where they lead nowhere.
    """
    longer, share, step = np.maximum(at.lengths - winches.lengths, 0.0), 0.0, 0.5
    while share < 1:
        after = min(1.0, share + step)
        part = replace(winches, lengths=winches.lengths + (1 - after) * longer)
        found = tightened(at, part, beside, arm)
        if found is not None:
            at, share, step = found, after, 2 * step
        elif step > _LEAST_STEP:
            step /= 2
        else:
            return None
    return at


def _stepped(at: _At, tensions: Array, beside: Callable[[_At, Array], _At | None]) -> _At | None:
    """Return the equilibrium that a step of the tensions, or a part of it, leads to."""
    for halved in range(_HALVINGS):
        found = beside(at, at.tensions + 0.5**halved * (tensions - at.tensions))
        if found is not None:
            return found
    return None
