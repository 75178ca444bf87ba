"""Functions of time that are known at five instants: what they can be in between.

The polynomial of fourth degree through five even instants lies in the convex hull of its Bernstein
coefficients. What the function differs from it by is bounded by the Chebyshev coefficients c_j that
come after the fifth, of which the interpolation sees the first five:

    |f - p| <= (1 + Lambda) sum over j > 4 of |c_j|,        Lambda = 2.208 of five even points.

Those of an analytic function fall geometrically. The one assumption is that they go on falling by
half or more each, so that the sum is |c_4| at the most. It is checked where it can be: `falls` asks
that |c_4| is no more than a quarter of |c_2| or |c_3|; where it is not, instants are too far apart.
Source: Trefethen, "Approximation Theory and Approximation Practice" (2013), chapters 8 and 15.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from model.paths import Array

Mask = NDArray[np.bool_]
INSTANTS = 5
SHARES = np.linspace(0.0, 1.0, INSTANTS)
_DEGREE = INSTANTS - 1
# 1 + Lambda, rounded up.
_LEBESGUE = 3.21
_BERNSTEIN = np.linalg.inv(
    [[comb(_DEGREE, k) * x**k * (1 - x) ** (_DEGREE - k) for k in range(INSTANTS)] for x in SHARES]
)
_CHEBYSHEV = np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * SHARES - 1, _DEGREE))


def control(values: Array) -> Array:
    """Return the Bernstein coefficients (K, 5, ...) of polynomials through values (K, 5, ...)."""
    return np.asarray(np.einsum("ij,kj...->ki...", _BERNSTEIN, values))


def chebyshev(values: Array) -> Array:
    """Return the Chebyshev coefficients (K, 5, ...) of polynomials through values (K, 5, ...)."""
    return np.asarray(np.einsum("ij,kj...->ki...", _CHEBYSHEV, values))


def tail(coefficients: Array) -> Array:
    """Return what functions may differ by (K, ...) from polynomials of Chebyshev coefficients."""
    return np.asarray(_LEBESGUE * np.abs(coefficients[:, -1]))


def falls(sizes: Array, least: float) -> Mask:
    """Return whether coefficients of sizes (K, 5) fall (K,), or are below what is rounding."""
    last = sizes[:, -1]
    return np.asarray((last <= 0.25 * sizes[:, 2:4].max(axis=1)) | (last <= least))


def highest(values: Array) -> Array:
    """Return an upper bound (K, ...) of functions by values (K, 5, ...)."""
    return np.asarray(control(values).max(axis=1) + tail(chebyshev(values)))
