"""Kinks of constraints in the tensions: a contact begins, ends, or passes an anchorage or edge.

On each side of a kink the constraints are smooth. Continuity leaves a jump of rank one between the
Jacobians of both sides: with the change d of the tensions, near a point on one side,

    c(d) = c + J d                                  for normal . d <= offset,
    c(d) = c + J d + jump (normal . d - offset)     beyond.

Each combination of sides is a piece, in which a step is a conic program. A point is a local optimum
to first order if no piece that contains it has a step of descent. This implies that 0 is in the
convex hull of the gradients of all pieces plus the normal cone of the limits (Clarke, Optimization
and Nonsmooth Analysis, 1983; Scheel and Scholtes, Mathematics of Operations Research 25, 2000).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from octoplan.model.paths import Array
from octoplan.planner.extensions.contact.program import Constraints

# Largest number of kinks that are remembered: each doubles the number of pieces.
MOST_KINKS = 3
# Cosine above which the normals of two kinks count as equal; share of the size of a kink below
# which a new one with the same normal is curvature of one of its sides.
_PARALLEL, _SMALLER = 0.9, 0.3


@dataclass(frozen=True, eq=False)
class Kink:
    """A jump of the Jacobian of the constraints.

    Attributes
    ----------
    jump : (m,)
        Change of the derivative of the numbers of the constraints along the normal.
    normal : (n,)
        Unit vector of scaled tensions, out of the side of the current point.
    offset : float
        Distance from the current point, at least 0.
    """

    jump: Array
    normal: Array
    offset: float

    @classmethod
    def between(cls, at: Constraints, there: Constraints) -> Kink | None:
        """Return the kink between two points, by the jump of rank one nearest to their Jacobians.

        None if the numbers of contacts on held objects differ, or if the Jacobians are equal.
        """
        here, beyond = at.numbers, there.numbers
        if here.shape != beyond.shape:
            return None
        change = there.tensions - at.tensions
        jumps = beyond - here
        # The stability margin, the first inequality, is linearised only near its bound.
        jumps[len(at.equal)] = 0.0
        u, sizes, v = np.linalg.svd(jumps[:, 1:], full_matrices=False)
        sign = 1.0 if v[0] @ change >= 0 else -1.0
        jump = sign * sizes[0] * u[:, 0]
        if not sizes[0] > 0:
            return None
        normal = sign * v[0]
        way = float(normal @ change)
        off = jumps[:, 0] - here[:, 1:] @ change
        return cls(jump, normal, float(np.clip(way - jump @ off / (jump @ jump), 0.0, way)))

    def after(self, at: Constraints, there: Constraints) -> Kink | None:
        """Return the kink as it is seen from the end of a step; None if numbers of contacts change.

        The Jacobian there decides on which side of the kink the step ends.
        """
        if there.numbers.shape != at.numbers.shape:
            return None
        jumps = (there.numbers - at.numbers)[:, 1:]
        passed = self.jump @ jumps @ self.normal > self.jump @ self.jump / 2
        beyond = float(self.normal @ (there.tensions - at.tensions)) - self.offset
        side = -1.0 if passed else 1.0
        return Kink(self.jump, side * self.normal, max(-side * beyond, 0.0))

    @property
    def size(self) -> float:
        """The norm of the jump."""
        return float(np.linalg.norm(self.jump))

    def is_like(self, other: Kink) -> bool:
        """Whether both kinks have about the same normal."""
        return bool(abs(self.normal @ other.normal) > _PARALLEL)


Kinks = tuple[Kink, ...]


def with_kink(kinks: Kinks, new: Kink | None) -> Kinks:
    """Return the largest kinks with a new kink.

    The larger of two kinks with the same normal stays, the new kink if they are about equal.
    """
    if new is None:
        return kinks
    same = [kink for kink in kinks if kink.jump.shape == new.jump.shape]
    if any(new.is_like(kink) and new.size < _SMALLER * kink.size for kink in same):
        return tuple(same)
    others = (kink for kink in same if not new.is_like(kink))
    return tuple(sorted((new, *others), key=lambda kink: -kink.size)[:MOST_KINKS])


def after_step(kinks: Kinks, at: Constraints, there: Constraints) -> Kinks:
    """Return the kinks as they are seen from the end of a step."""
    return tuple(kink for each in kinks if (kink := each.after(at, there)) is not None)


def pieces(at: Constraints, kinks: Sequence[Kink], reach: Array) -> list[Constraints]:
    """Return the smooth pieces of the constraints that changes within `reach` (n,) may come to."""
    shape = (len(at.numbers),)
    near = [
        kink
        for kink in kinks
        if kink.jump.shape == shape and kink.offset <= float(np.abs(kink.normal) @ reach)
    ]
    return [_piece(at, near, beyond) for beyond in product((False, True), repeat=len(near))]


def _piece(at: Constraints, kinks: Sequence[Kink], beyond: Sequence[bool]) -> Constraints:
    """Return the piece on the given sides of kinks."""
    if not kinks:
        return at
    numbers = at.numbers.copy()
    rows = []
    for kink, is_beyond in zip(kinks, beyond, strict=True):
        row = np.append(-kink.offset, kink.normal)
        if is_beyond:
            numbers += np.outer(kink.jump, row)
        rows.append(row if is_beyond else -row)
    return at.with_numbers(numbers, np.array(rows))
