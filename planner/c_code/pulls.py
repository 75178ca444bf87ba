"""Pull along the arm as polynomials, carried on from section to section.

Where offsets are linear in s, the sums over tendons that a section asks for are polynomials of
degree two at most. An anchorage adds those of its own tendons to the coefficients of the part
beyond, so that the work grows with the number of tendons, not with its square.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section.statics import ClosedStatics
from model.paths import Array, Linear
from model.stations import stations

TERMS = 3


@dataclass(frozen=True, eq=False)
class PullPolynomials:
    """The coefficients of pull in (1 - s/L)^2, (1 - s/L) s/L and (s/L)^2.

    That basis keeps all digits at both ends: at a slender tip, and where an anchorage is near the
    base.

    Attributes
    ----------
    length : float
        L [m].
    own : one array a section, tip first
        (3 n_pull, n) coefficients per newton of its n tendons, term by term.
    """

    length: float
    own: tuple[Array, ...]

    @classmethod
    def of(cls, arm: Arm, statics: ClosedStatics) -> PullPolynomials | None:
        """Return the polynomials of an arm, None where an offset is not linear."""
        if not all(isinstance(path, Linear) for _, path in arm.offset_paths):
            return None
        parts = []
        for i, section in enumerate(arm.sections):
            s = section.at * np.array([0.0, 0.5, 1.0])
            maps = statics.pulls(arm, stations(arm, s, np.full(TERMS, i + 1)))
            maps = maps[:, :, list(arm.tendons_of(i + 1))]
            parts.append(_coefficients(maps, section.at / arm.length))
        return cls(arm.length, tuple(parts))

    def basis(self, s: Array) -> Array:
        """Return the three terms at arc lengths s: (3, N)."""
        v = s / self.length
        u = 1 - v
        return np.stack([u * u, u * v, v * v])

    def carried(self, T: ca.MX) -> list[ca.MX]:
        """Return the coefficients (n_pull, 3) where 0, 1, .. sections cross, of tensions T."""
        results = [ca.MX(self.own[0].shape[0] // TERMS, TERMS)]
        start = 0
        for each in self.own:
            added = ca.sparsify(ca.DM(each)) @ T[start : start + each.shape[1]]
            results.append(results[-1] + ca.reshape(added, -1, TERMS))
            start += each.shape[1]
        return results


def _coefficients(values: Array, share: float) -> Array:
    """Return (3 n_pull, n) from the values (3, n_pull, n) at 0, share / 2, share of the length.

    First the Bernstein form on that stretch, then, with t = v / share and 1 - t = u - k v, that in
    u = 1 - s/L and v = s/L.
    """
    first, middle, last = values[0], 2 * values[1] - (values[0] + values[2]) / 2, values[2]
    k = (1 - share) / share
    mixed = 2 * (middle / share - k * first)
    square = k * k * first - 2 * k * middle / share + last / share**2
    return np.concatenate([first, mixed, square])
