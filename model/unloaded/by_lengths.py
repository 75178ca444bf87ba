"""Tensions by lengths where each cross-section settles by itself.

Tendons of the least compliance are solved for at once or, where that fails, by continuation from
more compliant ones; from there their compliance is taken away, as far as rounding of the lengths
allows.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import ROUNDING, is_firm, least
from model.errors import ConvergenceError, UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.unloaded.compliant_tendons import CompliantTendons, moved
from model.unloaded.tendon_lengths import FEW, Lengths, TendonLengths, tendon_lengths
from model.unloaded.too_short import SHORT, refuse
from model.winches import Winches, least_compliance

# Where no combination of tensions changes lengths by less than this share of what others do, one
# step does.
_FIRM = 1e-8
# The last step with few points of the quadrature; what it leaves is their error.
_BEGUN = 1e-4, 1e-3
# Else so many steps, of which one does that changes tensions by no more than this share.
_TIGHTENED, _LAST = 12, 1e-6
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
        self.winches, self.least, self._short = winches, least_compliance(arm), SHORT * arm.length
        self._nearly = NEARLY * arm.length
        self._lengths = tendon_lengths(arm, scene, machine_code)
        self._few = tendon_lengths(arm, scene, machine_code, FEW)
        self._tendons = CompliantTendons(arm, winches, self._lengths)

    def found(self, near: Array | None = None) -> Found:
        """Return tensions by lengths; the least where lengths leave them undetermined.

        Tensions `near` are begun with. Raises InputError where no shape has the lengths, and
        UnsettledSectionError, ConvergenceError.
        """
        found = self._tendons.maximum(self._begun(near), self.least)
        if found is None:
            found = self._by_continuation()
        if self._tendons.lacks(found) > self._short:
            refuse(self._tendons, found)
        found = self._determined(found)
        left = self.winches.lacks(found.lengths, found.tensions)
        left = np.where(self.winches.held, left, np.nan)
        return Found(found.tensions, left)

    def _begun(self, near: Array | None) -> Lengths:
        """Return where to begin: where few points of the quadrature lead, if anywhere."""
        tendons = CompliantTendons(self._tendons.arm, self.winches, self._few)
        with suppress(UnsettledSectionError):
            found = tendons.maximum(self._first(near, self._few), self.least, _BEGUN)
            if found is not None:
                return self._lengths(found.tensions)
        return self._first(near, self._lengths)

    def _first(self, near: Array | None, lengths: TendonLengths) -> Lengths:
        if near is None and not self.winches.tensions.any():
            return lengths.at_rest
        return lengths(self.winches.tensions if near is None else near)

    def _by_continuation(self) -> Lengths:
        """Return the shape found by making the tendons less and less compliant."""
        at, lacked = self._lengths(self.winches.tensions), np.inf
        for multiple in _COMPLIANCES:
            found = self._tendons.maximum(at, multiple * self.least)
            if found is None:
                break
            at = found
            lacks = self._tendons.lacks(at)
            if lacks > max(lacked / 2, self._short):
                refuse(self._tendons, at)
            lacked = lacks
        if found is None:
            refuse(self._tendons, at)
            raise ConvergenceError(0.0, np.inf, "ask for lengths nearer to those at rest")
        return at

    def _determined(self, found: Lengths) -> Lengths:
        """Return what inextensible tendons come to, near those of the least compliance."""
        T = found.tensions.copy()
        if is_firm(self._tendons.matrix_of(self._tight(found), found), _FIRM):
            taut, M, lacks = self._taut(found)
            T[taut] += np.linalg.solve(M, -lacks)
            return found if T.min(initial=0.0) < 0 else moved(found, T)
        for _ in range(_TIGHTENED):
            tight, T = self._tight(found), found.tensions.copy()
            left = self.winches.lacks(found.lengths, T)[tight]
            T[tight] = least(
                self._tendons.matrix_of(tight, found),
                left,
                T[tight],
                ROUNDING * self._tendons.arm.length,
            )
            done = np.abs(T - found.tensions).max() <= _LAST * T.max(initial=0.0)
            if done:
                return moved(found, T)
            found = self._lengths(T)
        return found

    def _taut(self, at: Lengths) -> tuple[Any, Array, Array]:
        """Return taut tendons, how what is left of them grows with tensions, and what is left."""
        taut = np.flatnonzero(self.winches.held & (at.tensions > 0))
        left = self.winches.lacks(at.lengths, at.tensions)[taut]
        return taut, self._tendons.matrix_of(taut, at), left

    def _tight(self, at: Lengths) -> Any:
        """Return tendons that are taut, or may be where tendons stretch less."""
        left = self.winches.lacks(at.lengths, at.tensions)
        near = (at.tensions > 0) | (left <= self._nearly)
        return np.flatnonzero(self.winches.held & near)
