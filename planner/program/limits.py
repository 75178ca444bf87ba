"""What the tendons may do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import LARGEST, finite_array, numbers
from model.errors import InputError
from model.paths import Array
from model.units import STROKE, warn_unusual

# Minima above this many times what bends the arm by 1 rad crush any arm, and digits are lost.
_MOST = 1e6
_ROWS = (list, tuple, np.ndarray)


@dataclass(frozen=True)
class Limits:
    """Bounds on the tensions, and on what winches take in.

    Attributes
    ----------
    upper, lower : (n_tendons,)
        [N]; upper may be infinite.
    total : float or None
        The most that all tendons together may pull [N].
    strokes : ((n_tendons,), (n_tendons,)) or None
        The least and the most that is taken in of each tendon from where winches are zeroed [m].
    stroke_zero : (n_tendons,) or None
        Lengths of the tendons there [m]; None where that is the straight arm at rest.
    """

    upper: tuple[float, ...]
    lower: tuple[float, ...]
    total: float | None = None
    strokes: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    stroke_zero: tuple[float, ...] | None = None

    @classmethod
    def of(cls, arm: Arm, upper: Any, lower: Any = 0.0, total: float | None = None) -> Limits:
        """Return limits for an arm from a number for all tendons, or one for each.

        Raises InputError for negative numbers, NaN, a lower bound above the upper one or past all
        bounds, and a total below the sum of the lower bounds.
        """
        high, low = each_tendon(arm, "tension_max", upper), each_tendon(arm, "tension_min", lower)
        if not np.all(np.isfinite(low)):
            raise InputError("tension_min", lower, "finite numbers")
        most = _MOST * natural_tensions(arm)
        for j in np.flatnonzero(low > most):
            name = f"tension_min[{j}] ({arm.tendon_name(int(j))})"
            allowed = f"up to {most[j]:g} N, {_MOST:g} times what bends the arm by 1 rad"
            raise InputError(name, float(low[j]), allowed)
        for j in np.flatnonzero(low > high):
            name = f"tension_min[{j}] ({arm.tendon_name(int(j))})"
            raise InputError(name, float(low[j]), f"up to its maximum, {high[j]:g} N")
        if total is not None:
            value = float(finite_array("total_pull", total, ()))
            if value < low.sum():
                raise InputError(
                    "total_pull", total, f"{low.sum():g} N, the sum of minima, or above"
                )
        return cls(tuple(high.tolist()), tuple(low.tolist()), total)

    def with_strokes(self, arm: Arm, most: Any, least: Any = None) -> Limits:
        """Return the limits with those of strokes, as `plan` takes them; None for no limits.

        Raises InputError for a most below or a least above 0, where the arm rests.
        """
        if most is None and least is None:
            return self
        high = each_tendon(arm, "stroke_max", np.inf if most is None else most)
        paid_out = high if least is None else each_tendon(arm, "stroke_min", _negated(least))
        for name, bound in (("stroke_max", high), ("stroke_min", paid_out)):
            if name == "stroke_max" or least is not None:
                warn_unusual(name, (bound / arm.length).tolist(), STROKE)
        return replace(self, strokes=(tuple((-paid_out).tolist()), tuple(high.tolist())))

    @property
    def keywords(self) -> dict[str, Any]:
        """The limits as keywords of `plan`."""
        least, most = self.strokes or (None, None)
        ends = {"tension_min": np.array(self.lower), "tension_max": np.array(self.upper)}
        zero = "straight" if self.stroke_zero is None else self.stroke_zero
        others = {"total_pull": self.total, "stroke_min": least, "stroke_max": most}
        return ends | others | {"stroke_zero": zero}

    def restricted(self, tendons: frozenset[int]) -> Limits:
        """Return the limits with all other tendons held at their lower bounds."""
        upper = [u if j in tendons else self.lower[j] for j, u in enumerate(self.upper)]
        return replace(self, upper=tuple(upper))


def each_tendon(arm: Arm, name: str, values: Any) -> Array:
    """Return numbers (n_tendons,) of 0 or above; InputError for what is no such number."""
    if np.isscalar(values) or (isinstance(values, np.ndarray) and values.ndim == 0):
        number = float(numbers(name, values, "a number, or one for each tendon"))
        if not number >= 0:
            raise InputError(name, values, "0 or a number above it")
        return np.full(arm.n_tendons, number)
    if not isinstance(values, _ROWS):
        raise InputError(name, values, "a number, or one for each tendon")
    flat = arm.flat(_finite(values), name)
    return np.where(flat >= LARGEST, np.inf, flat)


def _negated(least: Any) -> Array:
    """Return how much may be paid out, of the least strokes, which are 0 or below."""
    allowed = "0 or a number below it, or one for each tendon"
    values = numbers("stroke_min", least, allowed)
    if not np.all(values <= 0):
        raise InputError("stroke_min", least, allowed)
    return np.asarray(np.abs(values))


def _finite(values: Any) -> Any:
    """Return numbers in rows with the largest one for infinity; the arm judges all else."""
    if isinstance(values, _ROWS):
        return [_finite(value) for value in values]
    return LARGEST if isinstance(values, float) and values == np.inf else values


@lru_cache(maxsize=64)
def natural_tensions(arm: Arm) -> Array:
    """Return for each tendon about the tension that bends the arm by 1 rad on its own [N].

    From the integral of y / EJ to its anchorage: the linear part of the closed form.
    """
    result = []
    for i, path in arm.offset_paths:
        end = arm.sections[i].at
        s = np.linspace(0.0, end, 201)
        y = np.abs(path.evaluate(s, end)[0])
        EJ = arm.material.E * np.pi * arm.radius.evaluate(s, arm.length)[0] ** 4 / 4
        bend = float(np.trapezoid(y / EJ, s))
        shorten = float(np.trapezoid(1 / (EJ * 4 / arm.radius.evaluate(s, arm.length)[0] ** 2), s))
        result.append(1 / max(bend, shorten / arm.length))
    return np.array(result)[list(arm.offset_of)]
