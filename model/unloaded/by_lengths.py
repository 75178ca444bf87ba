"""Tensions by lengths where each cross-section settles by itself.

A few Newton steps on few points of the quadrature tell which tendons are taut, some more with all
points come to tendons that do not stretch. Where that fails, tendons of the least compliance are
solved for by steps that are searched along, or by continuation from more compliant ones; from there
their compliance is taken away, as far as rounding of the lengths allows.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import ROUNDING, is_firm, least, singular_values, solved
from model.errors import ConvergenceError, UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from model.unloaded.compliant_tendons import CompliantTendons, moved
from model.unloaded.tendon_lengths import FEW, Lengths, TendonLengths, tendon_lengths
from model.unloaded.too_short import SHORT, refuse
from model.winches import Winches, least_compliance

# Where no combination of tensions changes lengths by less than this share of what others do, one
# step does.
_FIRM = 1e-8
# Calls of Newton steps with few points of the quadrature, which are done where the last one changes
# tensions by no more than this share of the largest.
_CALLS, _ROUGHLY = 3, 1e-2
# Steps with all points, of which one does that changes tensions by no more than this share. Where
# lengths are met to rounding a larger change is that of tensions which these hardly feel.
_TIGHTENED, _LAST, _FELT = 12, 1e-5, 1e-3
# Slack over the arm's length of tendons that their least compliance may have slackened.
NEARLY = 1e-9
# Compliances of a continuation, as multiples of the least, where the least is not arrived at
# directly.
_COMPLIANCES = (1e8, 1e6, 1e4, 1e2, 1.0)


class Found(NamedTuple):
    """Tensions by lengths.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    left : (n_tendons,)
        What is left of held tendons beyond their paths [m], nan of others.
    """

    tensions: Array
    left: Array


class UnloadedLengths:
    """An arm without loads, whose tendons winches hold."""

    def __init__(
        self, arm: Arm, scene: Scene, winches: Winches, machine_code: bool = False
    ) -> None:
        self.winches, self.least, self._L = winches, least_compliance(arm), arm.length
        self._lengths = tendon_lengths(arm, scene, machine_code)
        self._few = tendon_lengths(arm, scene, machine_code, FEW)
        self._tendons = CompliantTendons(arm, winches, self._lengths)

    def found(self, near: Array | None = None) -> Found:
        """Return tensions by lengths; the least where lengths leave them undetermined.

        Tensions `near` are begun with. Raises InputError where no shape has the lengths, and
        UnsettledSectionError, ConvergenceError.
        """
        found = self._soon(near)
        if found is None:
            at = self._searched(near)
            found = self._determined(self._lengths, at) or at
        left = self.winches.lacks(found.lengths, found.tensions)
        left = np.where(self.winches.held, left, np.nan)
        return Found(found.tensions, left)

    def _begun(self, near: Array | None) -> Array | None:
        """Return tensions that few points of the quadrature lead to, if they lead anywhere."""
        winches = self.winches
        soft, held = winches.stretch + self.least, winches.held.astype(float)
        at = self._first(near, self._few)
        for _ in range(_CALLS):
            check_time()
            at, to, solved = self._few.stepped(at, winches.lengths, soft, held)
            change = np.abs(to - at.tensions).max()
            if not np.isfinite(change):
                return None
            if solved and change <= _ROUGHLY * to.max():
                taut = np.flatnonzero(winches.held & (to > 0))
                if is_firm(self._tendons.matrix_of(taut, at), _FIRM):
                    return to
                found = self._determined(self._few, moved(at, to), roughly=True)
                return None if found is None else found.tensions
        return None

    def _soon(self, near: Array | None) -> Lengths | None:
        """Return the shape that few steps lead to; None if they do not."""
        if not self.winches.tensions.any():
            at = self._lengths.at_rest
            if self._tendons.lacks(at) <= ROUNDING * self._L:
                return at
        with suppress(UnsettledSectionError):
            T = self._begun(near)
            found = None if T is None else self._determined(self._lengths, self._lengths(T))
            if found is not None and self._tendons.lacks(found) <= SHORT * self._L:
                return found
        return None

    def _searched(self, near: Array | None) -> Lengths:
        """Return the shape of tendons of the least compliance, from rest or tensions nearby."""
        found = self._tendons.maximum(self._first(near, self._lengths), self.least)
        if found is None:
            found = self._by_continuation()
        if self._tendons.lacks(found) > SHORT * self._L:
            refuse(self._tendons, found)
        return found

    def _first(self, near: Array | None, lengths: TendonLengths) -> Lengths:
        if near is None and not self.winches.tensions.any():
            return lengths.at_rest
        T = self.winches.tensions
        return lengths(T if near is None else np.where(self.winches.held, near, T))

    def _by_continuation(self) -> Lengths:
        """Return the shape found by making the tendons less and less compliant."""
        at, lacked = self._lengths(self.winches.tensions), np.inf
        for multiple in _COMPLIANCES:
            found = self._tendons.maximum(at, multiple * self.least)
            if found is None:
                break
            at = found
            lacks = self._tendons.lacks(at)
            if lacks > max(lacked / 2, SHORT * self._L):
                refuse(self._tendons, at)
            lacked = lacks
        if found is None:
            refuse(self._tendons, at)
            raise ConvergenceError(0.0, np.inf, "ask for lengths nearer to those at rest")
        return at

    def _determined(
        self, lengths: TendonLengths, at: Lengths, roughly: bool = False
    ) -> Lengths | None:
        """Return what inextensible tendons come to, nearby; None if it takes too many steps.

        The last step is small and, where lengths hardly feel some tensions, they are met before it;
        `roughly` asks for less. A tendon that has slackened is tight again only where nothing is
        left of it, but for what others lack so far.
        """
        winches, rounding = self.winches, ROUNDING * self._L
        nearly, met = np.full(at.tensions.size, NEARLY * self._L), False
        for _ in range(_TIGHTENED):
            left, before = winches.lacks(at.lengths, at.tensions), met
            taut = at.tensions > 0
            level = 2 * np.abs(left[winches.held & taut]).max(initial=0.0)
            tight = np.flatnonzero(winches.held & (taut | (left <= np.maximum(nearly, level))))
            T = at.tensions.copy()
            T[tight], well = self._stepped(tight, at, left[tight], rounding)
            change, after = np.abs(T - at.tensions).max(), moved(at, T)
            met = np.abs(left[tight]).max(initial=0.0) <= rounding
            share = _ROUGHLY if roughly else _LAST if well else _FELT * met
            if before or change <= share * T.max(initial=0.0):
                beyond = np.delete(
                    winches.held & (winches.lacks(after.lengths, T) <= nearly), tight
                )
                if not beyond.any():
                    return after
            nearly[taut & (T == 0)] = rounding
            at = lengths(T)
        return None

    def _stepped(self, tight: Any, at: Lengths, left: Array, rounding: float) -> tuple[Array, bool]:
        """Return the tensions of tight tendons (n,) after a Newton step, of several the least.

        And whether all combinations of them that lengths feel at all are felt well.
        """
        M, T = self._tendons.matrix_of(tight, at), at.tensions[tight]
        if not T.size:
            return T, True
        values = singular_values(M)
        weak = values <= _FIRM * values[0]
        if not weak.any():
            after = T - solved(M, left)
            if after.min() >= 0:
                return after, True
        well = not (weak & (values * np.abs(T).max() > rounding)).any()
        return least(M, left, T, rounding), well
