"""Tensions by lengths where each cross-section settles by itself.

A few Newton steps on few points of the quadrature tell which tendons are taut, some more with all
points come to tendons that do not stretch. Where that fails, tendons of the least compliance are
solved for by steps that are searched along, or by continuation from more compliant ones; from there
their compliance is taken away, as far as rounding of the lengths allows.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import ROUNDING, least
from model.errors import ConvergenceError, UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from model.unloaded.compliant_tendons import CompliantTendons, moved
from model.unloaded.tendon_lengths import FEW, SETTLED, Lengths, TendonLengths, tendon_lengths
from model.unloaded.too_short import SHORT, refuse
from model.winches import Winches, least_compliance

# Calls of Newton steps with few points of the quadrature, which are done where the last one changes
# tensions by no more than this share of the largest.
_CALLS, _ROUGHLY = 3, 1e-2
# Steps with all points, of which one does that changes tensions by no more than this share, or that
# will be off by no more than this share of rounding.
_TIGHTENED, _LAST, SQUARE = 12, 1e-5, 0.1
# What is left of taut tendons after a step, over rounding, where others keep them from it.
_APART = 10.0
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
            found = self._determined(at) or at
        left = self.winches.lacks(found.lengths, found.tensions)
        left = np.where(self.winches.held, left, np.nan)
        return Found(found.tensions, left)

    def _begun(self, near: Array | None) -> Lengths | None:
        """Return the shape that few points of the quadrature lead to, if they lead anywhere."""
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
                return self._lengths.beside(self._few, at, to)
        return None

    def _soon(self, near: Array | None) -> Lengths | None:
        """Return the shape that few steps lead to; None if they do not."""
        if not self.winches.tensions.any():
            at = self._lengths.at_rest
            if self._tendons.lacks(at) <= ROUNDING * self._L:
                return at
        with suppress(UnsettledSectionError):
            begun = self._begun(near)
            found = None if begun is None else self._determined(begun)
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

    def _determined(self, at: Lengths) -> Lengths | None:
        """Return what inextensible tendons come to, nearby; None if it takes too many steps.

        The last step is small; or, since the steps are Newton's, what lengths will be off after it
        is rounding: that goes by the square of steps. A tendon that has slackened is tight again
        only where nothing is left of it, but for what others lack so far; one that keeps taut ones
        from their lengths is not.
        """
        winches, held, rounding = self.winches, self.winches.held, ROUNDING * self._L
        nearly, last = np.full(at.tensions.size, NEARLY * self._L), 0.0
        for _ in range(_TIGHTENED):
            left, taut = winches.lacks(at.lengths, at.tensions), at.tensions > 0
            level = 2 * np.abs(left[held & taut]).max(initial=0.0)
            limit = np.where(nearly > 0, np.maximum(nearly, level), -rounding)
            (tight,) = (held & (taut | (left <= limit))).nonzero()
            M, own = self._tendons.matrix_of(tight, at), left[tight]
            T = at.tensions.copy()
            T[tight], well, whole = least(M, own, T[tight], rounding)
            beside = own + M @ (T - at.tensions)[tight]  # what will be left of them
            slack = (T[tight] == 0) & (beside > rounding)
            apart = np.abs(beside[T[tight] > 0]).max(initial=0.0) > _APART * rounding
            change, off = np.abs(T - at.tensions).max(), np.abs(own).max(initial=0.0)
            small = well and change <= _LAST * T.max()
            small |= off * change**2 <= SQUARE * rounding * last**2
            if at.off <= SETTLED and whole and small and not (apart and slack.any()):
                after = moved(at, T)
                beyond = held & (winches.lacks(after.lengths, T) <= nearly)
                beyond[tight] = False
                if not beyond.any():
                    return after
            nearly[taut & (T == 0)], last = rounding, change
            if apart and whole:
                nearly[tight[slack]] = -rounding
            at = self._lengths.near(at, T)
        return None
