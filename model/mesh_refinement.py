"""Which meshes are tried for an accuracy, and what the difference between two of them says."""

from __future__ import annotations

import bisect
import math
from functools import lru_cache
from typing import Any

from model.checks import within

LOOSEST, FINEST_ACCURACY = 0.1, 1e-12
# Whole numbers, each at most twice the one two places before: a mesh is seldom finer than needed.
REFINEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
FINEST = REFINEMENTS[-1]
CAUTION = 4.0
# What rounding leaves, over L: of explicit maps, and of equilibria found by Newton's method.
ROUNDING, IMPLICIT = 1e-14, 5e-13


def checked_accuracy(accuracy: Any) -> float:
    """Return the accuracy as a float; InputError outside of [1e-12, 0.1]."""
    return within("accuracy", accuracy, FINEST_ACCURACY, LOOSEST)


@lru_cache(maxsize=64)
def first_pair(accuracy: float, order: int) -> tuple[int, int]:
    """Return the two refinements to begin with, one about twice the other.

    A first mesh is good to about 10^(1 - order) of the length, for arms that are bent but not
    rolled up.
    """
    guess = (CAUTION * 10.0 ** (1 - order) / accuracy) ** (1 / order)
    fine = next(r for r in REFINEMENTS if r >= min(max(guess, 2), 64))
    coarse = max(r for r in REFINEMENTS if r <= fine / 2)
    return coarse, fine


def estimate(gap: Any, coarse: Any, fine: int, order: int, rounding: float = ROUNDING) -> Any:
    """Return the tip error over L of the finer of two meshes whose tips are a gap apart, over L."""
    return CAUTION * gap / ((fine / coarse) ** order - 1) + rounding


def next_refinement(refinement: int, error: float, accuracy: float, order: int) -> int:
    """Return the refinement that should do after one that left an error, 0 past the finest.

    Where an error is far off its estimate says little: no more than four times as fine at once,
    twice where there is no estimate.
    """
    finer = _finer(refinement)
    if not finer:
        return 0
    more = (error / accuracy) ** (1 / order) if math.isfinite(error) else 2.0
    return finer[min(bisect.bisect_left(finer, refinement * more), len(finer) - 1)]


@lru_cache(maxsize=64)
def _finer(refinement: int) -> list[int]:
    return [r for r in REFINEMENTS if refinement < r <= 4 * refinement]
