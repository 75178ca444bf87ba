"""Functions of arc length: the radius of the body, the offsets and the turns of the tendons."""

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
from octoplan.model.support.value import unit, value

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# Tolerance of equal arc lengths, over the arm's length.
SAME = 1e-9


@runtime_checkable
class Path(Protocol):
    """A continuous function of arc length on [0, span]."""

    def __hash__(self) -> int:
        """Return the hash of the value."""

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """Value [m], first [-] and second [1/m] derivative at s [m], each of the shape of s.

        The derivatives at a kink are those on its base side.
        """

    def knots(self) -> tuple[float, ...]:
        """Return the arc lengths [m] where the function is not smooth."""

    def kinks(self) -> tuple[float, ...]:
        """Return the knots [m] at which the first derivative jumps."""


SUCH[Path] = "a Linear, a PiecewiseLinear or a Sampled path"


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

    def kinks(self) -> tuple[float, ...]:
        """See Path.kinks."""
        return ()


@value
class PiecewiseLinear:
    """Straight lines between given values, with kinks at the inner arc lengths.

    The kinks are nodes of all meshes. A tendon with a kink pulls sideways there, and the strains
    may jump.

    Attributes
    ----------
    s : tuple of float
        Arc lengths from the base, increasing, at least two [m].
    values : tuple of float
        The values there [m].
    """

    s: Annotated[tuple[float, ...], Meta(min_length=2)]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        _check_samples("PiecewiseLinear", self.s, self.values)

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """See Path.evaluate. Raises InputError if the arc lengths do not cover [0, span]."""
        _check_cover("PiecewiseLinear", self.s, span)
        slopes = np.diff(self.values) / np.diff(self.s)
        line = np.clip(np.searchsorted(self.s, s, side="left") - 1, 0, slopes.size - 1)
        return np.interp(s, self.s, self.values), slopes[line], np.zeros_like(s)

    def knots(self) -> tuple[float, ...]:
        """See Path.knots."""
        return self.s[1:-1]

    def kinks(self) -> tuple[float, ...]:
        """See Path.kinks."""
        return self.s[1:-1]


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
        _check_samples("Sampled", self.s, self.values)

    def evaluate(self, s: Array, span: float) -> tuple[Array, Array, Array]:
        """See Path.evaluate. Raises InputError if the samples do not cover [0, span]."""
        _check_cover("Sampled", self.s, span)
        spline = _spline(self)
        x = np.clip(s, self.s[0], self.s[-1])
        return spline(x), spline(x, 1), spline(x, 2)

    def knots(self) -> tuple[float, ...]:
        """See Path.knots."""
        return self.s[1:-1]

    def kinks(self) -> tuple[float, ...]:
        """See Path.kinks."""
        return ()


# Descriptions of functions of arc length in files.
_PATH = "[base, end], or samples"
_PATHS = f"{_PATH}, or a list with one for each tendon"
LengthPath = Annotated[Path, unit("mm", description=_PATH)]
LengthPaths = Annotated[Path | tuple[Path, ...], unit("mm", description=_PATHS)]
AnglePaths = Annotated[Path | tuple[Path, ...], unit("deg", description=_PATHS)]
CurvaturePath = Annotated[Path, unit("1/m", description=_PATH)]


def _check_samples(name: str, s: tuple[float, ...], values: tuple[float, ...]) -> None:
    """Raise InputError if the samples of a path are not a function of arc length."""
    finite_array(f"{name}.values", values, (len(s),))
    if np.any(np.diff(s) <= 0):
        raise InputError(f"{name}.s", s, "strictly increasing arc lengths")


def _check_cover(name: str, s: tuple[float, ...], span: float) -> None:
    """Raise InputError if the samples of a path do not cover [0, span]."""
    if s[0] > 1e-12 * span or s[-1] < span * (1 - 1e-12):
        raise InputError(f"{name}.s", (s[0], s[-1]), f"samples from 0 to {length_text(span)}")


@lru_cache(maxsize=256)
def _spline(path: Sampled) -> Any:
    return scipy.interpolate.make_interp_spline(path.s, path.values)
