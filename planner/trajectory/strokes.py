"""The lengths of tendons along the straight way between waypoints, and their derivatives.

On each stretch they are the polynomial through Chebyshev points, of a degree that is doubled until
its last coefficients are rounding: lengths are smooth functions of the tensions. Source: Trefethen,
"Approximation Theory and Approximation Practice" (2013), chapter 8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from model.errors import ConvergenceError
from model.paths import Array

# Degrees that are tried, and what their last coefficients may be, over the largest change.
_DEGREES, _ROUNDING = (8, 16, 32, 64, 128), 1e-7
_REMEDY = "somewhere between two waypoints it snaps: put waypoints where it does not"
# Tensions -> lengths, both (n_tendons,).
Lengths = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Stretch:
    """The lengths of tendons from one waypoint to the next.

    Attributes
    ----------
    coefficients : (degree + 1, n_tendons)
        Of Chebyshev polynomials in 2 share - 1 [m].
    """

    coefficients: Array

    @classmethod
    def of(cls, lengths: Lengths, start: Array, end: Array) -> Stretch:
        """Return the stretch between tensions (n_tendons,), by the lengths (n_tendons,) of them.

        Raises ConvergenceError where lengths are not smooth, or the arm does not settle.
        """
        for degree in _DEGREES:
            x = chebyshev.chebpts1(degree + 1)
            values = np.array([lengths(start + (1 + u) / 2 * (end - start)) for u in x])
            if not np.all(np.isfinite(values)):
                raise ConvergenceError(_ROUNDING, np.inf, _REMEDY)
            found = chebyshev.chebfit(x, values, degree)
            least = _ROUNDING * np.abs(found[1:]).max() + 1e-12
            if np.abs(found[-2:]).max() <= least:
                return cls(found)
        raise ConvergenceError(_ROUNDING, np.inf, _REMEDY)

    def derivatives(self, share: Array, order: int = 1) -> Array:
        """Return derivatives (K, n_tendons) of the lengths by the share [m], at shares (K,)."""
        found = chebyshev.chebder(self.coefficients, order, scl=2.0)
        return np.asarray(chebyshev.chebval(2 * share - 1, found).T)
