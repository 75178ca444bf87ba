"""Tendons that stretch a little: tensions by lengths as the maximum of a concave function.

With exact tendons the energy is convex in the strains and so are the lengths, so that the shape of
least energy is one, and its tensions maximise a concave function: least energy over shapes plus
tensions times what tendons lack. Its gradient is what they lack, its Hessian d lengths / d tensions
comes from the cross-sections alone, and the maximum under T >= 0 is found by projected Newton
steps, each a linear complementarity problem. Source: Boyd and Vandenberghe, Convex Optimization
(2004), chapter 5. Where the law has no energy, as with the paper's tangent, the same steps solve
the same equations, without a proof that there is one solution only. A tendon compliance keeps
steps definite.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import complementary
from model.errors import UnsettledSectionError
from model.paths import Array
from model.time_limit import check_time
from model.unloaded.tendon_lengths import Lengths, TendonLengths
from model.winches import Winches

_STEPS, _HALVINGS = 60, 20
# What tendons may lack in the end, over the arm's length: rounding, or what does not get less.
_ROUNDING, _MET = 1e-16, 1e-12
# The last step, whose square is rounding: what it changes of lengths over the arm's length, and of
# tensions over the largest.
_LAST_STEP = 1e-7, 1e-5
# Steps may leave at most this share of the slope along them, on either side of the maximum.
_SLOPE = 0.9


class CompliantTendons:
    """An arm without loads, whose tendons are held by length and stretch a little.

    Attributes
    ----------
    arm : Arm
    winches : Winches
    lengths : TendonLengths
    held : (n,)
        The tendons that winches hold.
    """

    def __init__(self, arm: Arm, winches: Winches, lengths: TendonLengths) -> None:
        self.arm, self.winches, self.lengths = arm, winches, lengths
        self.held = np.flatnonzero(winches.held)

    def by(self, winches: Winches) -> CompliantTendons:
        """Return the same arm with other winches."""
        return CompliantTendons(self.arm, winches, self.lengths)

    def maximum(self, at: Lengths, compliance: float) -> Lengths | None:
        """Return the shape where tendons have this compliance [m/N]; None if none is found."""
        last, L = np.inf, self.arm.length
        soft = self.winches.stretch + compliance
        for _ in range(_STEPS):
            check_time()
            left = self._left(at, soft)
            off = self._off(at, left, soft) / L
            if off <= _ROUNDING or (off <= _MET and off > last / 2):
                return at
            to = self._newton(at, left, soft)
            if to is None:
                return None
            change = to - at.tensions
            if off <= _LAST_STEP[0] and np.abs(change).max() <= _LAST_STEP[1] * to.max():
                return moved(at, to)
            searched = self._searched(at, change, left, soft)
            if searched is None:
                return None
            at, last = searched, off
        return None

    def _left(self, at: Lengths, soft: Array) -> Array:
        """Return what is left of tendons (n_tendons,) that stretch by `soft` [m/N]."""
        return np.asarray(self.winches.lengths + soft * at.tensions - at.lengths)

    def _off(self, at: Lengths, left: Array, soft: Array) -> float:
        """Return how far tensions and what is left are from complementary [m]."""
        own = soft - at.by_tensions.diagonal()
        off = np.abs(np.minimum(left, own * at.tensions))
        return float(off[self.held].max(initial=0.0))

    def _newton(self, at: Lengths, left: Array, soft: Array) -> Array | None:
        """Return tensions after a Newton step."""
        held, T = self.held, at.tensions
        M = -at.by_tensions
        M.ravel()[:: T.size + 1] += soft
        if held.size == T.size:
            return complementary(M, left - M @ T, T > 0)
        M, own, after = M[held[:, None], held], T[held], T.copy()
        found = complementary(M, left[held] - M @ own, own > 0)
        if found is None:
            return None
        after[held] = found
        return after

    def _searched(self, at: Lengths, change: Array, left: Array, soft: Array) -> Lengths | None:
        """Return what a step, or a part of it, leads to."""
        slope = abs(float(change @ left))
        most = _SLOPE * slope + _MET * self.arm.length * float(np.abs(change).max())
        for halving in range(_HALVINGS):
            try:
                after = self.lengths(at.tensions + 0.5**halving * change)
            except UnsettledSectionError:
                continue
            if float(change @ self._left(after, soft)) <= most:
                return after
        return None

    def lacks(self, at: Lengths) -> float:
        """Return what the tendon that lacks most lacks [m]."""
        lacks = self.winches.lacks(at.lengths, at.tensions)[self.winches.held]
        return float(-lacks.min(initial=0.0))

    def matrix_of(self, own: Any, at: Lengths) -> Array:
        """Return how what is left of tendons (n,) grows with their tensions (n, n) [m/N]."""
        found = -at.by_tensions[own[:, None], own]
        found.ravel()[:: own.size + 1] += self.winches.stretch[own]
        return np.asarray(found)


def moved(at: Lengths, to: Array) -> Lengths:
    """Return the lengths under tensions so near that their second derivatives do not matter."""
    return at._replace(tensions=to, lengths=at.lengths + at.by_tensions @ (to - at.tensions))
