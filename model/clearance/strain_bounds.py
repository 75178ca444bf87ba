"""How far strains can be from straight lines while tensions change along a straight line.

Without loads each cross-section is in equilibrium by itself: w(y, T) = w_0(y) + sum T_j w_j(y) = 0
for its curvatures and stretch y. On the way from T_a to T_b, of which t goes from 0 to 1,

    dy/dt = - D^-1 sum (T_b - T_a)_j w_j(y),        D = dw/dy.

Over a box Y around the equilibria y_a and y_b interval arithmetic bounds D and the right side, and
with them dy/dt (Neumaier, "Interval Methods for Systems of Equations", 1990, chapter 4). If every
matrix in the bounds of D is regular, w is one to one in Y; if besides no strain that starts at y_a
and changes at such rates can leave Y before t = 1, the equilibrium stays in Y, and arrives at y_b
(Moore, Kearfott, Cloud, chapter 10). Then a quarter of the width of dy/dt bounds how far y is from
the straight line between y_a and y_b: that is proven, but for rounding, at the mesh's stages.

Under loads cross-sections are coupled, and there is no such proof here: strains are compared with
the shape halfway, and taken to be at most twice as far from the line anywhere as there. That is a
check at steps, of which the largest is told (`Found.step`), and no proof.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.clearance.intervals import Bounded, Interval
from model.cross_section.law import CrossSection, body_size
from model.cross_section.sections import Sections
from model.machine.compiled import built
from model.paths import Array
from model.stations import Counts

Mask = NDArray[np.bool_]
# The box around both ends, over their distance; strains that count as none, over 1 / radius and 1.
_AROUND, _NONE = 0.4, 1e-9
# Under loads: how often farther than halfway, the most that the bent way may be of the change, and
# how far the arm may turn in a part [rad].
_FARTHER, _BENT, _TURN = 2.0, 0.25, 1.0


class Spread(NamedTuple):
    """By how much strains may be off from a straight line during P parts of a way.

    Attributes
    ----------
    kappa, nu : (P, N)
        Of curvature [1/m] and tangent [-] at N stages, as lengths of vectors.
    known : (P,)
        Whether that holds; else the part is too long to tell.
    """

    kappa: Array
    nu: Array
    known: Mask


def proven(sections: Sections, T: tuple[Array, Array], y: tuple[Array, Array]) -> Spread:
    """Return the spread without loads between two tensions (P, n_tendons), with strains (P, N, 3).

    Strains are curvatures about n and b [1/m] and the tangent's length, per unit reference length.
    """
    n = 2 + sections.law.extension
    start, end = (each[..., :n] for each in y)
    curvature = np.sqrt(sections.body[0] / sections.body[1])
    unit = np.column_stack([curvature, curvature, np.ones(curvature.size)])[:, :n]
    change = np.abs(end - start)
    margin = unit * (_AROUND * (change / unit).max(axis=2, keepdims=True) + _NONE)
    box = Interval(np.minimum(start, end) - margin, np.maximum(start, end) + margin)
    rate = _rates(sections, T, box)
    stays = (start + rate.low >= box.low) & (start + rate.high <= box.high)
    wide = np.where(np.isfinite(rate.radius), rate.radius, 0.0) / 2
    nu = wide[..., 2] if n == 3 else np.zeros(wide.shape[:2])
    known = np.all(stays, axis=(1, 2))
    return Spread(np.hypot(wide[..., 0], wide[..., 1]), nu, np.asarray(known))


def estimated(start: Array, halfway: Array, end: Array, length: float) -> Spread:
    """Return the spread under loads by kappa and nu (P, N, 6) at both ends and halfway.

    Of an arm of a `length` [m]; known where that is small beside the change, and the change small.
    """
    bent = _FARTHER * np.abs(halfway - (start + end) / 2)
    kappa, nu = (np.linalg.norm(each, axis=2) for each in np.split(bent, 2, axis=2))
    change = np.linalg.norm((end - start)[..., :3], axis=2).mean(axis=1) * length
    known = kappa.mean(axis=1) * length <= _BENT * change + _NONE
    return Spread(kappa, nu, known & (change <= _TURN))


def _rates(sections: Sections, T: tuple[Array, Array], box: Interval) -> Interval:
    """Return bounds (P, N, n) of dy/dt over boxes (P, N, n), NaN where D may be singular."""
    P, N, n = box.low.shape
    body, tendon = built(_functions, sections.law)
    pulls = np.any(T[0] + T[1], axis=0)
    used = np.flatnonzero(np.asarray(pulls)[sections.tendon])
    place, which = sections.place[used], sections.tendon[used]

    def rows(values: Array, over: Counts) -> Array:
        return values[:, over].reshape(P * len(over), -1)

    def fixed(values: Array) -> Interval:
        tiled = np.tile(values.T, (P, 1))
        return Interval(tiled, tiled)

    everywhere = np.arange(N)
    at_body = Interval(*(rows(each, everywhere) for each in box))
    at_tendons = Interval(*(rows(each, place) for each in box))
    D = body(at_body, fixed(sections.body))
    wrench = tendon(at_tendons, fixed(sections.paths[:, used]))
    a, b = (each[:, which].reshape(-1, 1) for each in T)
    pull, change = Interval(np.minimum(a, b), np.maximum(a, b)), Interval(b - a, b - a)
    into = (np.arange(P)[:, None] * N + place).ravel()
    jacobian = [each.copy() for each in D]
    right = [np.zeros((P * N, n)) for _ in D]
    for k, each in enumerate(Interval(*(w[:, n:] for w in wrench)).times(pull)):
        np.add.at(jacobian[k], into, each)
    for k, each in enumerate(Interval(*(w[:, :n] for w in wrench)).times(change)):
        np.add.at(right[k], into, each)
    result = _solved(Interval(*(each.reshape(-1, n, n) for each in jacobian)), Interval(*right))
    return Interval(*(-each.reshape(P, N, n) for each in result[::-1]))


def _solved(D: Interval, right: Interval) -> Interval:
    """Return bounds (K, n) of D^-1 right over matrices (K, n, n); NaN where one may be singular.

    With C near the inverse of the middle of D, C D = I + E: D^-1 b is within (I - |E|)^-1 (|E| |x|
    + r) of x, C times the middle of b, r the radius of C b. I - |E| is inverse positive if it maps
    some positive vector to one: the solution for a positive right side is looked at for that.
    """
    finite = np.isfinite(D.radius.sum(axis=(1, 2))) & np.isfinite(right.radius.sum(axis=1))
    good: Mask = np.asarray(finite)
    n = right.low.shape[1]
    middle = np.where(good[:, None, None], D.middle, np.eye(n))
    good &= np.abs(np.linalg.det(middle)) > 0
    C = np.linalg.inv(np.where(good[:, None, None], middle, np.eye(n)))
    E = np.abs(C) @ np.where(good[:, None, None], D.radius, 0.0)
    x = np.einsum("kij,kj->ki", C, np.where(good[:, None], right.middle, 0.0))
    r = np.einsum("kij,kj->ki", np.abs(C), np.where(good[:, None], right.radius, 0.0))
    size = np.einsum("kij,kj->ki", E, np.abs(x)) + r
    size += 1e-12 * np.abs(x) + 1e-300
    within = np.eye(n) - E
    good &= np.linalg.det(within) > 0
    off = np.linalg.solve(np.where(good[:, None, None], within, np.eye(n)), size[..., None])[..., 0]
    good &= off.min(axis=1) > 0
    off = np.where(good[:, None], off, np.nan)
    return Interval(x - off, x + off)


def _functions(law: CrossSection) -> tuple[Bounded, Bounded]:
    """Return strains, numbers of the body -> D of the body; strains, path -> wrench and its D.

    Derivatives column by column.
    """
    y = ca.SX.sym("y", 2 + law.extension)
    along = y[2] if law.extension else ca.SX(1)
    v = law.strains(ca.vertcat(0, y[:2]), ca.vertcat(along, 0, 0))
    body, path = ca.SX.sym("body", body_size(law)), ca.SX.sym("path", 4)
    wrench = law.tendon(v, path)
    of_body = ca.vec(ca.densify(ca.jacobian(law.body(v, body), y)))
    both = ca.densify(ca.vertcat(wrench, ca.vec(ca.jacobian(wrench, y))))
    options = {"cse": True}
    return (
        Bounded(ca.Function("body", [y, body], [of_body], options)),
        Bounded(ca.Function("tendon", [y, path], [both], options)),
    )
