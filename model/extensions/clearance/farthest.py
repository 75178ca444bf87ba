"""Largest gap between a part of an arm and a convex body.

On a straight segment, a convex distance is at most the larger end value. Distances are Lipschitz
continuous with constant 1. Therefore the distance of a piece of the midline is at most the larger
distance of the ends plus the sag: a curve of length l between two points at a distance c stays
within sqrt(l^2 - c^2) / 2 of the chord. Pieces are halved until this bound is close to the
largest evaluated excess.
"""

from __future__ import annotations

import numpy as np

from octoplan.model.centreline import Centreline, Counts
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array

# Largest number of halvings, which divide the whole arm into pieces of less than 1e-6.
_LEVELS = 24
# Number of points for locating local maxima, which parabolas through three points refine.
_POINTS = 1025


def largest_excess(
    line: Centreline, body: Convex, factor: float, part: tuple[float, float], close: float
) -> float:
    """Return an upper bound of the distance of a midline from a body, minus factor R(s) [m].

    The part of the arm is delimited by arc lengths [m]; R is the outer radius at rest. The bound is
    at most `close` [m] above the largest value.
    """
    element, low, high = _pieces(line, part)
    seen = bound = -np.inf
    for level in range(_LEVELS + 1):
        above, ends = _bounds(line, body, factor, element, low, high)
        seen = max(seen, float(ends.max(initial=-np.inf)))
        is_open = above > seen + close
        if level == _LEVELS:
            bound = max(bound, float(above.max(initial=-np.inf)))
            break
        bound = max(bound, float(above[~is_open].max(initial=-np.inf)))
        element = element[is_open]
        low = low[is_open]
        high = high[is_open]
        if not element.size:
            break
        middle = (low + high) / 2
        element = np.tile(element, 2)
        low = np.append(low, middle)
        high = np.append(middle, high)
    return max(bound, seen)


def _pieces(line: Centreline, part: tuple[float, float]) -> tuple[Counts, Array, Array]:
    """Return the elements in a part of an arm, and the shares that delimit the part in each."""
    start, end = np.clip(part, line.s[0], line.s[-1])
    h = np.diff(line.s)
    low = np.clip((start - line.s[:-1]) / h, 0.0, 1.0)
    high = np.clip((end - line.s[:-1]) / h, 0.0, 1.0)
    element = np.flatnonzero(high > low)
    return element, low[element], high[element]


def _bounds(
    line: Centreline, body: Convex, factor: float, element: Counts, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return upper bounds (K,) of the excess on pieces, and the excess at both ends (2, K) [m]."""
    zero = np.zeros(low.size)
    first = line.along(element, zero, low)[0]
    last, length, _ = line.along(element, low, high)
    distance = np.array([body.at(first)[0], body.at(last)[0]])
    s = line.s[element] + np.array([low, (low + high) / 2, high]) * np.diff(line.s)[element]
    radius = line.arm.outer_radius(s.ravel())[0].reshape(s.shape)
    # Along a piece, the radius is a parabola except for terms of third order.
    bent = np.abs(radius[0] - 2 * radius[1] + radius[2])
    chord = np.linalg.norm(last - first, axis=1)
    sag = np.sqrt(np.maximum(length**2 - chord**2, 0.0)) / 2
    above = distance.max(axis=0) + sag - factor * (radius.min(axis=0) - bent)
    return above, distance - factor * radius[[0, 2]]


def maxima(
    line: Centreline, body: Convex, factor: float, part: tuple[float, float]
) -> tuple[Array, Array]:
    """Return the arc lengths [m] and values of local maxima of the excess along a part."""
    s = np.linspace(max(part[0], line.s[0]), min(part[1], line.s[-1]), _POINTS)
    excess = body.at(line.at(s)[0])[0] - factor * line.arm.outer_radius(s)[0]
    before = excess[:-2]
    at = excess[1:-1]
    after = excess[2:]
    top = np.flatnonzero((at >= before) & (at > after))
    bend = (before - 2 * at + after)[top]
    slope = (after - before)[top] / 2
    share = np.divide(-slope, bend, out=np.zeros(top.size), where=bend < 0)
    refined = s[top + 1] + share * (s[1] - s[0])
    return refined, at[top] + share * slope / 2
