"""Tensions of a low-discrepancy sequence over the box of limits, with its faces."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.planner.limits import TendonLimits, natural_tensions
from octoplan.planner.solve.guesses import within_total

# Smallest level of a tendon that pulls, and largest level below the limit, in tensions that bend
# the arm by 1 rad [-]. The largest level bends a slender tip; stronger tensions crush most arms.
_LEAST = 0.05
_MOST = 60.0
# Share of the pulling tendons at the maximum: faces, edges and corners of the box [-].
_AT_MAXIMUM = 0.2
# Smallest and largest share of the tendons that pull in a sample [-].
_PULLING = (0.1, 0.9)


def sobol(count: int, dimensions: int, seed: int) -> Array:
    """Return points (count, dimensions) of the unit cube: Sobol's sequence, shifted at random.

    The shift is modulo 1 [Cranley1976]: the same seed gives the same points in each version of
    SciPy.
    """
    from scipy.stats import qmc  # slow to import, rarely needed

    exponent = max(count - 1, 1).bit_length()
    points = qmc.Sobol(dimensions, scramble=False).random_base2(exponent)[:count]
    return np.asarray((points + np.random.default_rng(seed).random(dimensions)) % 1.0)


def sampled_tensions(arm: Arm, limits: TendonLimits, count: int, seed: int) -> Array:
    """Return tensions (count, n_tendons) within limits [N].

    The first set has all tendons at the minimum; in each of the next sets one tendon is at the
    maximum. The others follow a low-discrepancy sequence: one coordinate is the share of the
    tendons that pull; for each tendon, one coordinate decides whether it pulls, and one is its
    level. Levels are uniform in half of the sets and log-uniform in the others, so that tendons of
    a slender tip and of a thick base bend the arm alike. A fifth of the pulling tendons are at
    their maximum.
    """
    n = arm.n_tendons
    low, high = np.array(limits.lower), np.array(limits.upper)
    natural = natural_tensions(arm)
    most = np.minimum(high - low, _MOST * natural)
    least = np.minimum(_LEAST * natural, most)
    corners = np.vstack([np.zeros(n), np.diag(high - low)])[:count]
    points = sobol(max(count - len(corners), 1), 2 * n + 2, seed)[: count - len(corners)]
    decision, level = points[:, :n], points[:, n : 2 * n]
    pulling = _PULLING[0] + (_PULLING[1] - _PULLING[0]) * points[:, -1:]
    ratio = np.divide(most, least, np.ones(n), where=least > 0)
    extra = np.where(points[:, -2:-1] < 0.5, least * ratio**level, level * most)
    extra = np.where(decision < _AT_MAXIMUM * pulling, high - low, extra)
    extra = np.where(decision < pulling, extra, 0.0)
    return within_total(low + np.vstack([corners, extra]), limits)
