"""Orders of measured tendons: mirrored, shifted, or by section from base to tip.

Wires and motors are often connected in another order than the one of the arm. The orders of a bad
fit are tried; see octoplan.planner.extensions.fit.calibrate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, pairwise, product
from typing import NamedTuple

import numpy as np

from octoplan.model import Arm
from octoplan.model.paths import Array
from octoplan.planner.extensions.fit.residuals import Evaluation, mean_distance, unreached

Tendons = tuple[int, ...]
# Mean error of markers, over their mean distance from their mean places, above which a fit is bad:
# the fit explains less than three quarters of the variance. Tendons in a wrong order err by the
# motion itself, a ratio of 1 or more.
_BAD = 0.5
# Smallest number of shapes in which a marker is seen, for its motion to count.
_SEEN = 3


class Order(NamedTuple):
    """An order of the measured tendons, and its fit.

    Attributes
    ----------
    tendons : tuple of int
        Index of the measured tendon that acts as each tendon of the arm (n_tendons,).
    misfit : float
        Negative log-likelihood up to a constant; inf if no shape settles.
    mean_error : float
        Mean distance between measured and predicted markers and tips [m].
    """

    tendons: Tendons
    misfit: float
    mean_error: float


def is_bad(at: Evaluation) -> bool:
    """Return whether a fit misses half of the shapes, or most of the motion of markers.

    A wrong order displaces most shapes; fewer shapes that are missed are outliers.
    """
    if 2 * len(unreached(at)) >= len(at.equilibria):
        return True
    motion = _motion(at)
    return bool(motion and mean_distance(at.named()) > _BAD * motion)


def common_orders(arm: Arm) -> Iterator[Tendons]:
    """Yield other orders: the same shift or mirror image in all sections, in both section orders.

    The order of the sections changes only if all have the same number of tendons.
    """
    counts = _counts(arm)
    identity = _identity(arm)
    sections = [list(range(len(counts)))]
    if len(set(counts)) == 1 and len(counts) > 1:
        sections.append(sections[0][::-1])
    seen = {tuple(chain(*identity))}
    for order, mirrored, shift in product(sections, (False, True), range(max(counts))):
        parts = [_turned(identity[i], shift, mirrored) for i in order]
        tendons = tuple(chain(*parts))
        if tendons not in seen:
            seen.add(tendons)
            yield tendons


def section_orders(arm: Arm, tendons: Tendons, section: int) -> Iterator[Tendons]:
    """Yield the orders with another shift or mirror image in one section."""
    parts = [[tendons[j] for j in part] for part in _identity(arm)]
    n = len(parts[section])
    for mirrored, shift in product((False, True), range(n)):
        turned = _turned(parts[section], shift, mirrored)
        if turned != parts[section]:
            yield tuple(chain(*parts[:section], turned, *parts[section + 1 :]))


def _turned(part: Sequence[int], shift: int, mirrored: bool) -> list[int]:
    """Return the tendons of a section, shifted and mirrored."""
    n = len(part)
    return [part[(shift - i if mirrored else shift + i) % n] for i in range(n)]


def _counts(arm: Arm) -> list[int]:
    """Return the number of tendons of each section."""
    sections = [section for section, _ in arm.tendons]
    return [sections.count(i) for i in dict.fromkeys(sections)]


def _identity(arm: Arm) -> list[list[int]]:
    """Return the indices of the tendons by section."""
    ends = np.cumsum([0, *_counts(arm)]).tolist()
    return [list(range(a, b)) for a, b in pairwise(ends)]


def _motion(at: Evaluation) -> float:
    """Return the mean distance of markers from their mean places [m]; 0 for few shapes.

    Markers of different sessions, and coordinates that are not always measured, do not compare.
    """
    seen = dict[tuple[str, str], list[Array]]()
    for i in at.equilibria:
        shape = at.experiment.shapes[i]
        for sensor, place in zip(shape.markers, shape.places, strict=True):
            seen.setdefault((shape.session, sensor.what), []).append(place)
    rows = [np.array(places) for places in seen.values() if len(places) >= _SEEN]
    distances = [
        np.sqrt(np.nansum(np.square(places - np.nanmean(places, axis=0)), axis=1))
        for places in (row[:, ~np.isnan(row).all(axis=0)] for row in rows)
    ]
    return float(np.mean(np.concatenate(distances))) if distances else 0.0
