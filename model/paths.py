"""Smooth functions of arc length: the radius of the body and the offsets of the tendons."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
import scipy
from msgspec import Meta
from numpy.typing import NDArray

from octoplan.model.support.checks import SUCH, finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text
from octoplan.model.support.value import value

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# Tolerance of equal arc lengths, over the arm's length.
SAME = 1e-9


@runtime_checkable
class Path(Protocol):
    """A smooth function of arc length on [0, span]."""

    def __hash__(self) -> int:
        """Return the hash of the value."""

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """Value [m], first [-] and second [1/m] derivative at s [m], each of the shape of s."""

    def knots(self) -> tuple[float, ...]:
        """Return the arc lengths [m] where the function is not smooth."""


SUCH[Path] = "a Linear or a Sampled path"


@value
class Linear:
    """Linear in s, eqs. (5) and (7).

    Attributes
    ----------
    base, end : float
        Value at s = 0 and at the end of the path [m]: a_i and b_i, or R_max and R_min.
    """

    base: float
    end: float

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """See Path.evaluate."""
        slope = (self.end - self.base) / span
        return self.base + slope * s, np.full_like(s, slope), np.zeros_like(s)

    def knots(self) -> tuple[float, ...]:
        """See Path.knots."""
        return ()


@value
class Sampled:
    """A cubic spline (not-a-knot) through samples.

    Attributes
    ----------
    s : tuple of float
        Arc lengths from the base, increasing, at least four [m].
    values : tuple of float
        The values there [m].
    """

    s: Annotated[tuple[float, ...], Meta(min_length=4)]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        finite_array("Sampled.values", self.values, (len(self.s),))
        if np.any(np.diff(self.s) <= 0):
            raise InputError("Sampled.s", self.s, "strictly increasing arc lengths")

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """See Path.evaluate. Raises InputError if the samples do not cover [0, span]."""
        if self.s[0] > 1e-12 * span or self.s[-1] < span * (1 - 1e-12):
            raise InputError(
                "Sampled.s", (self.s[0], self.s[-1]), f"samples from 0 to {length_text(span)}"
            )
        spline = _spline(self)
        x = np.clip(s, self.s[0], self.s[-1])
        return spline(x), spline(x, 1), spline(x, 2)

    def knots(self) -> tuple[float, ...]:
        """See Path.knots."""
        return self.s[1:-1]


@lru_cache(maxsize=256)
def _spline(path: Sampled) -> Any:
    return scipy.interpolate.make_interp_spline(path.s, path.values)
