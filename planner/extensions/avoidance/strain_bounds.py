"""How far strains can be from straight lines while tensions change along a straight line.

Without loads each cross-section is in equilibrium by itself: w(y, T) = w_0(y) + sum T_j w_j(y) = 0
for its curvatures and stretch y. On the way from T_a to T_b, of which t goes from 0 to 1,

    dy/dt = - D^-1 sum (T_b - T_a)_j w_j(y),        D = dw/dy.

Over a box Y around the equilibria y_a and y_b interval arithmetic bounds D and the right side, and
with them dy/dt (Neumaier, "Interval Methods for Systems of Equations", 1990, chapter 4). If every
matrix in the bounds of D is regular, w is one to one in Y; if besides no strain that starts at y_a
and changes at such rates can leave Y before t = 1, the equilibrium stays in Y, and arrives at y_b
(Moore, Kearfott, Cloud, "Introduction to Interval Analysis", 2009, chapter 10). Then a quarter of
the width of dy/dt bounds how far y is from the straight line between y_a and y_b: that is proven,
but for rounding, at the mesh's stages.

Under loads cross-sections are coupled, and there is no such proof here: strains are compared with
the shape halfway, and taken to be at most twice as far from the line anywhere as there. That is a
check at steps, of which the largest is told (`ClearanceBound.step`), and no proof.

An interval is an array whose first axis has the lower and the upper bound; one of length 1 is a
number. Every value of a function for arguments inside of boxes is inside of its bounds, but for
rounding; they are wider than its range where an argument is used more than once, by a part that
shrinks with the square of the box (the same, chapters 5 and 6).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, body_size
from octoplan.model.cross_section.sections import Sections
from octoplan.model.extensions.clearance.pieces import DeviationBound
from octoplan.model.paths import SAME, Array, Mask
from octoplan.model.support.machine.functions import cached, instructions

# The box around both ends, over their distance.
_AROUND = 0.4
# Under loads: how often farther than halfway, the most that the bent way may be of the change, and
# how far the arm may turn in a part [rad].
_FARTHER, _BENT, _TURN = 2.0, 0.25, 1.0


def proven(sections: Sections, T: Array, y: Array) -> DeviationBound:
    """Return the spread without loads between two tensions (2, P, n_tendons) with two strains.

    Strains (2, P, N, 3) are curvatures about n and b [1/m] and the tangent's length, per unit
    reference length.
    """
    y = y[..., : 2 + sections.law.extension]
    curvature = np.sqrt(sections.body[0] / sections.body[1])
    unit = np.column_stack([curvature, curvature, np.ones(curvature.size)])[:, : y.shape[3]]
    change = (np.abs(y[1] - y[0]) / unit).max(axis=2, keepdims=True)
    margin = unit * (_AROUND * change + SAME)
    box = np.array([y.min(axis=0) - margin, y.max(axis=0) + margin])
    rate = _rates(sections, T, box)
    stays = (y[0] + rate[0] >= box[0]) & (y[0] + rate[1] <= box[1])
    wide = np.where(np.isfinite(rate).all(axis=0), rate[1] - rate[0], 0.0) / 4
    kappa, nu = np.hypot(wide[..., 0], wide[..., 1]), wide[..., 2:].sum(axis=2)
    return DeviationBound(kappa, nu, np.asarray(stays.all(axis=(1, 2))))


def estimated(ends: Array, halfway: Array, length: float) -> DeviationBound:
    """Return the spread under loads by kappa and nu at both ends (2, P, N, 6) and halfway.

    Of an arm of a `length` [m]; known where that is small beside the change, and the change small,
    and strains halfway are numbers.
    """
    bent = _FARTHER * np.abs(halfway - ends.mean(axis=0))
    kappa, nu = (np.linalg.norm(each, axis=2) for each in np.split(bent, 2, axis=2))
    change = np.linalg.norm((ends[1] - ends[0])[..., :3], axis=2).mean(axis=1) * length
    known = kappa.mean(axis=1) * length <= _BENT * change + SAME
    return DeviationBound(kappa, nu, known & (change <= _TURN))


def _rates(sections: Sections, T: Array, box: Array) -> Array:
    """Return bounds (2, P, N, n) of dy/dt over boxes of that shape; NaN where D may be singular."""
    _, P, N, n = box.shape
    body, tendon = cached(_functions, sections.law)
    used = np.flatnonzero(np.asarray(T.any(axis=(0, 1)))[sections.tendon])
    place, pulls = sections.place[used], T[:, :, sections.tendon[used]]
    at_tendons = box[:, :, place].reshape(2, -1, n), np.tile(sections.paths[:, used].T, (1, P, 1))
    wrench, by_strains = np.split(tendon(*at_tendons), [n], axis=2)
    change, pulls = (pulls[1] - pulls[0]).reshape(1, -1, 1), np.sort(pulls, axis=0)
    rows = [times(wrench, change), times(by_strains, pulls.reshape(2, -1, 1))]
    right = np.zeros((2, P * N, n))
    D = body(box.reshape(2, -1, n), np.tile(sections.body.T, (1, P, 1)))
    for sums, each in zip((right, D), rows, strict=True):
        for k in range(2):
            np.add.at(sums[k], (np.arange(P)[:, None] * N + place).ravel(), each[k])
    return -_solved(D.reshape(2, -1, n, n), right)[::-1].reshape(box.shape)


def _solved(D: Array, right: Array) -> Array:
    """Return bounds (2, K, n) of D^-1 right over matrices (2, K, n, n), right sides (2, K, n).

    NaN where a matrix may be singular. With C near the inverse of the middle of D, C D = I + E:
    D^-1 b is within (I - |E|)^-1 (|E| |x| + r) of x, C times the middle of b, r the radius of C b.
    I - |E| is inverse positive if it maps some positive vector to one: the solution for a positive
    right side is looked at for that.
    """
    n = right.shape[2]
    good: Mask = np.isfinite(D.sum(axis=(0, 2, 3))) & np.isfinite(right.sum(axis=(0, 2)))
    D, right = np.where(good[:, None, None], D, np.eye(n)), np.where(good[:, None], right, 0.0)
    good &= np.linalg.det(D.mean(axis=0)) != 0
    C = np.linalg.inv(np.where(good[:, None, None], D.mean(axis=0), np.eye(n)))
    E = np.abs(C) @ (D[1] - D[0]) / 2
    x = np.einsum("kij,kj->ki", C, right.mean(axis=0))
    r = np.einsum("kij,kj->ki", np.abs(C), (right[1] - right[0]) / 2)
    size = np.einsum("kij,kj->ki", E, np.abs(x)) + r
    size += 1e-12 * np.abs(x) + 1e-300
    good &= np.linalg.det(np.eye(n) - E) > 0
    within = np.eye(n) - np.where(good[:, None, None], E, 0.0)
    off = np.linalg.solve(within, size[..., None])[..., 0]
    off[~good | (off.min(axis=1) <= 0)] = np.nan
    return np.array([x - off, x + off])


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


def times(a: Array, b: Array) -> Array:
    """Return the interval of the product."""
    with np.errstate(invalid="ignore"):
        products = [x * y for x in a for y in b]
    return np.array([reduce(np.minimum, products), reduce(np.maximum, products)])


def _inverse(a: Array) -> Array:
    """Return 1 / a; everything where a has both signs."""
    with np.errstate(divide="ignore"):
        low, high = 1 / a[-1], 1 / a[0]
    both = a[0] * a[-1] <= 0
    return np.array([np.where(both, -np.inf, low), np.where(both, np.inf, high)])


def _square(a: Array) -> Array:
    least = np.maximum(np.maximum(a[0], -a[-1]), 0.0)
    return np.array([least**2, np.maximum(a[0] ** 2, a[-1] ** 2)])


_OPERATIONS: dict[int, Callable[..., Array]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b[::-1],
    ca.OP_NEG: lambda a: -a[::-1],
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_MUL: times,
    ca.OP_DIV: lambda a, b: times(a, _inverse(b)),
    ca.OP_INV: _inverse,
    ca.OP_SQ: _square,
    ca.OP_SQRT: lambda a: np.sqrt(np.maximum(a, 0.0)),
}


class Bounded:
    """An SX function of dense vectors, built of sums, products, quotients, squares and roots."""

    def __init__(self, function: ca.Function) -> None:
        self._size, self._steps = function.numel_out(0), instructions(function)

    def __call__(self, *boxes: Array) -> Array:
        """Return bounds (2, N, n_out) of the first result over boxes (1 or 2, N, n_in)."""
        result = np.zeros((2, self._size, boxes[0].shape[1]))
        columns = [np.ascontiguousarray(np.moveaxis(box, 2, 0)) for box in boxes]
        work: dict[int, Array] = {}
        for operation, inputs, out, constant in self._steps:
            if operation == ca.OP_OUTPUT:
                result[:, out[1]] = work[inputs[0]]
            elif operation == ca.OP_INPUT:
                work[out[0]] = columns[inputs[0]][inputs[1]]
            elif operation == ca.OP_CONST:
                work[out[0]] = np.array([[constant]])
            else:
                work[out[0]] = _OPERATIONS[operation](*(work[i] for i in inputs))
        return np.moveaxis(result, 1, 2)
