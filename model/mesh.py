"""Meshes along the arm, graded for its taper."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import SAME, Array, Path
from octoplan.model.rod.collocation import gauss
from octoplan.model.stations import Counts

_FINE = 64
# Growth, as an exponent, that costs half an element, and the most halves that a stretch may cost.
_GROWTH, _MOST = 3.0, 0.5
# Angle by which a tendon turns around the midline in one unit of the graded sum [rad]. Strains vary
# with this angle: three Gauss stages over 1.2 rad leave 1e-4 of the length, over 2.4 rad 5e-3.
_TURN = 1.5


@dataclass(frozen=True, eq=False)
class Mesh:
    """Steps along the arm, from base to tip.

    Attributes
    ----------
    s : (S + 1,)
        The nodes, among them every anchorage and every station asked for [m].
    active : (S,)
        How many sections' tendons cross each step.
    """

    s: Array
    active: Counts

    @cached_property
    def steps(self) -> int:
        """The number of steps S."""
        return self.active.size

    def segment_ends(self) -> tuple[Array, Counts]:
        """Return both ends of each anchorage segment, and how many sections cross there."""
        last = np.flatnonzero(np.diff(self.active, append=-1))
        first = np.concatenate([[0], last[:-1] + 1])
        ends = np.column_stack([self.s[first], self.s[last + 1]]).ravel()
        return ends, np.repeat(self.active[last], 2)

    def points(self, m: int) -> tuple[Array, Array, Counts]:
        """Return m Gauss points a step: where they are (m S,), weights, how many sections cross."""
        method, h = gauss(m), np.diff(self.s)
        s = self.s[:-1, None] + h[:, None] * method.c
        return s.ravel(), np.outer(h, method.b).ravel(), np.repeat(self.active, m)

    def node(self, s: float) -> int:
        """Return the index of the node at arc length s, which has to be one of the mesh's."""
        return int(np.argmin(np.abs(self.s - s)))


def graded(
    arm: Arm,
    refinement: int,
    at: Iterable[float] = (),
    growth_rate: Callable[[Array], Array] | None = None,
    taper: Path | None = None,
    weights: tuple[float, float] = (1.0, 1.0),
    steps_per_unit: float = 2.0,
) -> Mesh:
    """Return a mesh whose steps are equal in log R(s) + s/L, refined by a whole number.

    Strains of a slender tip change with R^-3 or so, so steps that are equal in log R spread the
    error evenly; the second term keeps a cylinder's steps finite. Tendons that turn around the
    midline shorten the steps in proportion. Doubling the refinement halves every step, so that
    differences between the two estimate the error.

    Parameters
    ----------
    at : iterable of float
        Arc lengths that have to be nodes [m].
    growth_rate : callable
        Arc lengths -> how fast the solution may grow or decay there [1/m]; steps are shorter where
        it does.
    taper : Path
        What to grade for; the arm's radius unless given. Its size does not matter.
    weights : (2,)
        Of log R and of s/L.
    steps_per_unit : float
        Steps in which their sum grows by 1, with a refinement of 1.
    """
    breaks = _breaks(arm, at)
    fine = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0, 1, _FINE + 1)
    R = (taper or arm.radius).evaluate(fine.ravel(), arm.length)[0].reshape(fine.shape)
    weight = weights[0] * np.abs(np.diff(np.log(R), axis=1))
    weight += weights[1] * np.diff(fine, axis=1) / arm.length
    weight += np.abs(np.diff(_turned(arm, fine), axis=2)).max(axis=0, initial=0.0) / _TURN
    if growth_rate is not None:
        rate = growth_rate(fine.ravel()).reshape(fine.shape)
        turns = (rate[:, 1:] + rate[:, :-1]) / 2 * np.diff(fine, axis=1)
        weight = weight + np.minimum(turns / _GROWTH, _MOST)
    total = np.zeros(fine.shape)
    np.cumsum(weight, axis=1, out=total[:, 1:])
    nodes = [breaks[:1]]
    for each, inside, right in zip(total, fine, breaks[1:], strict=True):
        count = refinement * max(1, int(np.ceil(steps_per_unit * each[-1])))
        inner = np.interp(each[-1] * np.arange(1, count + 1) / count, each, inside)
        inner[-1] = right
        nodes.append(inner)
    return with_nodes(arm, np.concatenate(nodes))


def _turned(arm: Arm, s: Array) -> Array:
    """Return the angle by which each tendon has turned at arc lengths (m, k): (n, m, k) [rad].

    Only tendons that turn; a tendon turns no further beyond its anchorage.
    """
    angles = [
        turn.evaluate(np.minimum(s, section.at), section.at)[0]
        for section in arm.sections
        for turn in section.turns
        if turn is not None
    ]
    return np.array(angles).reshape(-1, *s.shape)


def with_nodes(arm: Arm, s: Array) -> Mesh:
    """Return the mesh of given nodes (S + 1,), every anchorage among them [m]."""
    ends = np.array([section.at for section in arm.sections])
    middle = (s[:-1] + s[1:]) / 2
    return Mesh(s, (ends[:, None] > middle).sum(axis=0))


def _breaks(arm: Arm, at: Iterable[float]) -> Array:
    """Return where the solution is not smooth, or is wanted: sorted and without near copies."""
    kept = list[float]()
    for s in landmarks(arm, at).tolist():
        if 0 <= s <= arm.length and all(abs(s - other) > SAME * arm.length for other in kept):
            kept.append(s)
    return np.sort(kept)


def landmarks(arm: Arm, at: Iterable[float] = ()) -> Array:
    """Return the arc lengths that a mesh has nodes at [m], in an order that stays."""
    knots = [s for path in arm.along for s in path.knots() if 0 < s < arm.length]
    return np.array([0.0, arm.length, *arm.anchorages, *knots, *at])
