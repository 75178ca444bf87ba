"""The arm along its length: meshes, graded for its taper, and the geometry of cross-sections."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.paths import SAME, Array, Path
from octoplan.model.rod.collocation import gauss
from octoplan.model.rotations import from_matrix

Counts = NDArray[np.int64]

# Gauss points per interval: exact for the volume if R^2 is a polynomial of at most degree 11.
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(6)
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
    """Elements along the arm, from base to tip.

    Attributes
    ----------
    s : (N + 1,)
        Arc lengths of the nodes [m], including all anchorages and requested stations.
    active : (N,)
        Number of anchorage sections whose tendons cross each element.
    """

    s: Array
    active: Counts

    @cached_property
    def elements(self) -> int:
        """The number of elements N."""
        return self.active.size

    def segment_ends(self) -> tuple[Array, Counts]:
        """Return both ends of each segment, and the number of anchorage sections that cross it."""
        last = np.flatnonzero(np.diff(self.active, append=-1))
        first = np.concatenate([[0], last[:-1] + 1])
        ends = np.column_stack([self.s[first], self.s[last + 1]]).ravel()
        return ends, np.repeat(self.active[last], 2)

    def points(self, m: int) -> tuple[Array, Array, Counts]:
        """Return arc lengths, weights and `active` of m Gauss points per element (m N,)."""
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
    """Return a mesh whose steps between required nodes have equal increments of a sum.

    The sum is log R(s) + s/L, plus the turning of tendons and the growth of the solution under
    loads. Strains of a slender tip vary about as R^-3: steps that are equal in log R distribute the
    error evenly. The second term limits the steps of a cylinder. Tendons that turn around the
    midline shorten the steps in proportion. Doubling the refinement halves each step, so that
    differences of the two meshes estimate the error.

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
    return tuple(sorted({mesh.node(s) for s in places} - {0, mesh.elements}))


def landmarks(arm: Arm, at: Iterable[float] = ()) -> Array:
    """Return the arc lengths of required nodes [m]: ends, anchorages, knots of paths and `at`."""
    knots = [s for path in arm.along for s in path.knots() if 0 < s < arm.length]
    return np.array([0.0, arm.length, *arm.anchorages, *knots, *at])


# Cross-sections at given arc lengths


@dataclass(frozen=True, eq=False)
class Stations:
    """Geometry of N cross-sections.

    Attributes
    ----------
    s : (N,)
        Arc lengths from the base [m].
    active : (N,)
        Number of anchorage sections whose tendons cross, counted from the tip. At an anchorage the
        number selects one of the two sides.
    radius : (N,)
        Radius of the body [m].
    y, y_rate, y_curve : (n_offsets, N)
        Offset y_i(s) of eq. (5) for each section, or for each tendon if offsets differ, and the
        first two derivatives. Zero beyond the end of the tendons.
    rest, rest_rate : (2, N) or (0, N)
        Curvature at rest about n and b [1/m], and the derivative; empty for a straight arm.
    """

    s: Array
    active: Counts
    radius: Array
    y: Array
    y_rate: Array
    y_curve: Array
    rest: Array
    rest_rate: Array


def stations(arm: Arm, s: Array, active: Counts) -> Stations:
    """Return the cross-sections at s (N,), each crossed by `active` anchorage sections."""
    R = arm.radius.evaluate(s, arm.length)[0]
    y = np.empty((3, len(arm.offset_paths), s.size))
    for row, (i, path) in enumerate(arm.offset_paths):
        end = arm.sections[i].at
        y[:, row] = path.evaluate(np.minimum(s, end), end) * (active > i)
    rest = arm.rest_curvature
    curved = [path.evaluate(s, arm.length)[:2] for path in (rest.n, rest.b)] if rest else []
    bends = np.array(curved).reshape(len(curved), 2, s.size)
    parts = (y[0], y[1], y[2], bends[:, 0], bends[:, 1])
    return Stations(s, active, R, *parts)


def tendon_directions(arm: Arm) -> tuple[Array, Array]:
    """Return cosine and sine of the angle of each tendon, exact for multiples of 90 degrees.

    Tensions in a plane then bend the arm in this plane exactly.
    """
    phi = np.array([angle for _, angle in arm.tendons])
    values = np.array([np.cos(phi), np.sin(phi)])
    nearest = np.round(values)
    cos, sin = np.where(np.abs(values - nearest) < 1e-15, nearest, values)
    return cos, sin


def crossing(arm: Arm, at: Stations) -> Array:
    """Return 1 if a tendon crosses a station, otherwise 0 (N, n_tendons)."""
    section = np.array([i for i, _ in arm.tendons])
    return (at.active[:, None] > section).astype(float)


def tendon_offsets(arm: Arm, at: Stations) -> Array:
    """Return Y = y d along n and b, 0 beyond the end of a tendon, and two derivatives (3, 2, N, n).

    The direction of a tendon that turns has the derivative d' = phi' d_perp.
    """
    offset = np.array([at.y, at.y_rate, at.y_curve])[:, list(arm.offset_of)].transpose(0, 2, 1)
    d = np.stack(tendon_directions(arm))[:, None]
    y = offset[:, None]
    if not any(arm.angle_paths):
        return np.asarray(y * d)
    turned = np.zeros(offset.shape)
    for j, turn in enumerate(arm.angle_paths):
        if turn is not None:
            end = arm.sections[arm.tendons[j][0]].at
            turned[..., j] = turn.evaluate(np.minimum(at.s, end), end)
    phi, phi_rate, phi_curve = turned
    d = np.stack([d[0] * np.cos(phi) - d[1] * np.sin(phi), d[0] * np.sin(phi) + d[1] * np.cos(phi)])
    across = np.stack([-d[1], d[0]])
    y, rate, curve = y
    twice = 2 * rate * phi_rate + y * phi_curve
    return np.stack(
        [y * d, rate * d + y * phi_rate * across, (curve - y * phi_rate**2) * d + twice * across]
    )


def tendon_paths(
    arm: Arm, at: Stations, place: Counts, tendon: Counts, derivative: int = 0
) -> Array:
    """Return the offset Y = y d along n and b, and its derivative (4, P), of tendons at stations.

    With `derivative=1` return the derivatives along s of these numbers. `place` (P,) and `tendon`
    (P,) are indices of stations and tendons.
    """
    rows = slice(derivative, derivative + 2)
    return tendon_offsets(arm, at)[rows, :, place, tendon].reshape(4, -1)


def volume(arm: Arm, s: Array) -> Array:
    """Return the volume of the body between arc lengths s (N,) and the tip [m3].

    By Gauss quadrature between the arc lengths and the knots of the body's paths, which is exact
    for paths that are polynomials up to the fifth degree in between.
    """
    knots = [at for path in (arm.radius, *arm.profile.paths) for at in path.knots()]
    ends = np.unique(np.concatenate([[0.0, arm.length], s, knots]))
    ends = ends[(ends >= 0) & (ends <= arm.length)]
    h = np.diff(ends)
    nodes = (ends[:-1] + h / 2)[:, None] + h[:, None] / 2 * _GAUSS
    area = arm.area(nodes.ravel()).reshape(nodes.shape)
    parts = h / 2 * (area @ _WEIGHTS)
    rest = np.concatenate([np.cumsum(parts[::-1])[::-1], [0.0]])
    return np.asarray(rest[np.searchsorted(ends, np.clip(s, 0.0, arm.length))])


def base_pose(arm: Arm) -> Array:
    """Return the clamped pose (7,) of the arm's base."""
    return np.append(from_matrix(np.array(arm.base_frame)), arm.base_position)
