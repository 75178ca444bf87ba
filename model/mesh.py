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

# Samples of the density of nodes between two landmarks.
_SAMPLES = 64
# Growth, as an exponent, in one unit of the graded sum.
_GROWTH = 3.0
# Largest contribution of growth to the graded sum between two samples.
_MAX_GROWTH = 0.5
# Angle by which a tendon turns around the midline in one unit of the graded sum [rad]. Strains vary
# with this angle: three Gauss stages over 1.2 rad leave an error of 1e-4 L, over 2.4 rad 5e-3 L.
_TURN = 1.5


@dataclass(frozen=True, eq=False)
class Mesh:
    """Steps along the arm, from base to tip.

    Attributes
    ----------
    s : (S + 1,)
        Arc lengths of the nodes [m], including all anchorages and requested stations.
    active : (S,)
        Number of anchorage sections whose tendons cross each step.
    """

    s: Array
    active: Counts

    @cached_property
    def steps(self) -> int:
        """The number of steps S."""
        return self.active.size

    def segment_ends(self) -> tuple[Array, Counts]:
        """Return both ends of each segment, and the number of anchorage sections that cross it."""
        last = np.flatnonzero(np.diff(self.active, append=-1))
        first = np.concatenate([[0], last[:-1] + 1])
        ends = np.column_stack([self.s[first], self.s[last + 1]]).ravel()
        return ends, np.repeat(self.active[last], 2)

    def points(self, m: int) -> tuple[Array, Array, Counts]:
        """Return arc lengths, weights and `active` of m Gauss points per step (m S,)."""
        method = gauss(m)
        h = np.diff(self.s)
        s = self.s[:-1, None] + h[:, None] * method.c
        return s.ravel(), np.outer(h, method.b).ravel(), np.repeat(self.active, m)

    def inside(self, elements: Counts, s: Array) -> Array:
        """Return arc lengths s (n,) in elements (n,), just beyond the first nodes of the elements.

        Derivatives of paths at a kink are those on its base side, and a kink is the last node of
        the element before.
        """
        first = np.nextafter(self.s[:-1], np.inf)
        return np.clip(s, first[elements], self.s[1:][elements])

    def node(self, s: float) -> int:
        """Return the index of the node at arc length s, which must be a node of the mesh."""
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

    Strains of a slender tip vary about as R^-3: steps that are equal in log R distribute the error
    evenly. The second term limits the steps of a cylinder. Tendons that turn around the midline
    shorten the steps in proportion. Doubling the refinement halves each step, so that differences
    of the two meshes estimate the error.

    Parameters
    ----------
    at : iterable of float
        Arc lengths of further nodes [m].
    growth_rate : callable
        Arc lengths -> bound of the growth or decay of the solution [1/m]; shortens the steps.
    taper : Path
        The function R(s), by default the radius of the arm. Only ratios matter.
    weights : (2,)
        Weights of log R and of s/L.
    steps_per_unit : float
        Number of steps per unit of the sum, for a refinement of 1.
    """
    breaks = _breaks(arm, at)
    fine = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0, 1, _SAMPLES + 1)
    R = (taper or arm.radius).evaluate(fine.ravel(), arm.length)[0].reshape(fine.shape)
    weight = weights[0] * np.abs(np.diff(np.log(R), axis=1))
    weight += weights[1] * np.diff(fine, axis=1) / arm.length
    weight += np.abs(np.diff(_turned(arm, fine), axis=2)).max(axis=0, initial=0.0) / _TURN
    if growth_rate is not None:
        rate = growth_rate(fine.ravel()).reshape(fine.shape)
        exponent = (rate[:, 1:] + rate[:, :-1]) / 2 * np.diff(fine, axis=1)
        weight = weight + np.minimum(exponent / _GROWTH, _MAX_GROWTH)
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
    """Return the angle by which each turning tendon has turned at s (m, k): (n, m, k) [rad].

    The angle is constant beyond the anchorage of a tendon.
    """
    angles = [
        turn.evaluate(np.minimum(s, section.at), section.at)[0]
        for section in arm.sections
        for turn in section.angle_paths
        if turn is not None
    ]
    return np.array(angles).reshape(-1, *s.shape)


def with_nodes(arm: Arm, s: Array) -> Mesh:
    """Return the mesh of given nodes (S + 1,) [m], which include all anchorages."""
    ends = np.array([section.at for section in arm.sections])
    middle = (s[:-1] + s[1:]) / 2
    return Mesh(s, (ends[:, None] > middle).sum(axis=0))


def _breaks(arm: Arm, at: Iterable[float]) -> Array:
    """Return the landmarks in order, without duplicates [m]."""
    kept = list[float]()
    for s in landmarks(arm, at).tolist():
        if 0 <= s <= arm.length and all(abs(s - other) > SAME * arm.length for other in kept):
            kept.append(s)
    return np.sort(kept)


def kinks(arm: Arm, mesh: Mesh) -> tuple[int, ...]:
    """Return the inner nodes at which paths of tendons have kinks, so that strains may jump."""
    places = {
        s
        for section in arm.sections
        for path in section.paths
        for s in path.kinks()
        if 0 < s < section.at
    }
    return tuple(sorted({mesh.node(s) for s in places} - {0, mesh.steps}))


def landmarks(arm: Arm, at: Iterable[float] = ()) -> Array:
    """Return the arc lengths of required nodes [m]: ends, anchorages, knots of paths and `at`."""
    knots = [s for path in arm.along for s in path.knots() if 0 < s < arm.length]
    return np.array([0.0, arm.length, *arm.anchorages, *knots, *at])
