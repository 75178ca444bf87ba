"""Limits of tensions and strokes, and the tensions that bend an arm by 1 rad."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import LARGEST, finite_array, is_several, kind, numbers
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.units import LARGEST_LIMIT, SMALLEST_LIMIT, STROKE, warn_unusual

# Tension that most plans do not exceed, over the tension that bends the arm by 1 rad [-].
NATURAL_RANGE = 5.0


@dataclass(frozen=True)
class Limits:
    """Limits of tensions and strokes.

    Each limit of a tendon is one number for all tendons, or one for each: (n_tendons,) in tendon
    order, or one row for each section. Sequences and arrays are kept as tuples. `plan`,
    `trajectory`, `workspace` and `check_arm` check the limits with the arm, and raise InputError
    for limits that are not allowed.

    Attributes
    ----------
    tension_max, tension_min : float, or one for each tendon
        Largest and smallest tension [N]; infinite and 0 unless given.
    total_pull : float or None
        Largest sum of all tensions [N]; no limit unless given.
    stroke_max : float, or one for each tendon, or None
        Largest stroke: the length that a winch takes in from its zero [m]. Slack tendons count, too
        (`Plan.strokes`). No limit unless given.
    stroke_min : float, or one for each tendon, or None
        Smallest stroke, 0 or below: minus the length that a winch can pay out [m]; minus
        `stroke_max` unless given.
    """

    tension_max: Any = np.inf
    tension_min: Any = 0.0
    total_pull: float | None = None
    stroke_max: Any = None
    stroke_min: Any = None

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, _as_tuples(getattr(self, item.name)))


@dataclass(frozen=True)
class TendonLimits:
    """Bounds on the tensions and strokes of an arm's tendons, with one number for each.

    Attributes
    ----------
    upper, lower : (n_tendons,)
        [N]; upper may be infinite.
    total : float or None
        Upper bound on the sum of the tensions [N].
    strokes : ((n_tendons,), (n_tendons,)) or None
        Smallest and largest stroke of each tendon: the length that the winch takes in [m].
    stroke_zero : (n_tendons,) or None
        Lengths of the tendons at stroke 0 [m]; None for the lengths in the straight arm at rest.
    """

    upper: tuple[float, ...]
    lower: tuple[float, ...]
    total: float | None = None
    strokes: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    stroke_zero: tuple[float, ...] | None = None

    @classmethod
    def of(cls, arm: Arm, upper: Any, lower: Any = 0.0, total: float | None = None) -> TendonLimits:
        """Return limits for an arm from a number for all tendons, or one for each.

        Raise InputError for negative numbers, NaN, a lower bound above the upper bound or above
        the tensions that crush any arm, and a total below the sum of the lower bounds.
        """
        high, low = each_tendon(arm, "tension_max", upper), each_tendon(arm, "tension_min", lower)
        if np.isinf(low).any():
            raise InputError("tension_min", lower, "finite numbers")
        with np.errstate(over="ignore"):
            shares = high / natural_tensions(arm)
        warn_unusual("tension_max", [float(shares.max())], LARGEST_LIMIT)
        warn_unusual("tension_max", [float(shares.min())], SMALLEST_LIMIT)
        # Minima above 1e6 times the tension that bends the arm crush any arm and lose digits.
        times = "up to {:g} N, 1e+06 times what bends the arm by 1 rad"
        bounds = (1e6 * natural_tensions(arm), times), (high, "up to its maximum, {:g} N")
        for most, allowed in bounds:
            for j in np.flatnonzero(low > most)[:1].tolist():
                name = f"tension_min[{j}] ({arm.tendon_name(j)})"
                raise InputError(name, float(low[j]), allowed.format(most[j]))
        # The sum has a rounding error.
        least = low.sum() * (1 - 1e-9)
        if total is not None and float(finite_array("total_pull", total, ())) < least:
            raise InputError("total_pull", total, f">= {low.sum():g} N, the sum of the minima")
        return cls(tuple(high.tolist()), tuple(low.tolist()), total)

    def with_strokes(self, arm: Arm, most: Any, least: Any = None) -> TendonLimits:
        """Return the limits with bounds on strokes, see `plan`; None for no bound.

        Raise InputError for an upper bound below 0, or a lower bound above 0.
        """
        if most is None and least is None:
            return self
        high = each_tendon(arm, "stroke_max", np.inf if most is None else most)
        warn_unusual("stroke_max", (high / arm.length).tolist(), STROKE)
        paid_out = high
        if least is not None:
            allowed = "a number <= 0, or one for each tendon"
            negative = numbers("stroke_min", least, allowed)
            if not np.all(negative <= 0):
                raise InputError("stroke_min", least, allowed)
            paid_out = each_tendon(arm, "stroke_min", np.abs(negative))
            warn_unusual("stroke_min", (paid_out / arm.length).tolist(), STROKE)
        return replace(self, strokes=(tuple((0.0 - paid_out).tolist()), tuple(high.tolist())))

    def of_tendons(self, pulling: Collection[int]) -> TendonLimits:
        """Return the limits with all other tendons fixed at the lower bounds."""
        both = enumerate(zip(self.lower, self.upper, strict=True))
        upper = tuple(most if j in pulling else least for j, (least, most) in both)
        return replace(self, upper=upper)

    @property
    def keywords(self) -> dict[str, Any]:
        """The limits as keyword arguments of `plan`."""
        least, most = self.strokes or (None, None)
        return {
            "limits": Limits(self.upper, self.lower, self.total, most, least),
            "stroke_zero": "straight" if self.stroke_zero is None else self.stroke_zero,
        }


def each_tendon(arm: Arm, name: str, values: Any) -> Array:
    """Return nonnegative numbers (n_tendons,); raise InputError for any other value."""
    if not is_several(values):
        number = float(numbers(name, values, "a number, or one for each tendon"))
        if not number >= 0:
            raise InputError(name, values, "a number >= 0")
        return np.full(arm.n_tendons, number)
    flat = arm.flat(_finite(values), name)
    return np.where(flat >= LARGEST, np.inf, flat)


def _as_tuples(values: Any) -> Any:
    """Return nested sequences and arrays as nested tuples; other values as they are."""
    if isinstance(values, np.ndarray):
        values = values.tolist()
    return tuple(map(_as_tuples, values)) if is_several(values) else values


def _finite(values: Any) -> Any:
    """Return numbers in rows, with LARGEST for infinity; Arm.flat checks other values."""
    if is_several(values):
        return [_finite(value) for value in values]
    return LARGEST if isinstance(values, float) and values == np.inf else values


@lru_cache(maxsize=64)
def natural_tensions(arm: Arm) -> Array:
    """Return, for each tendon, the tension that alone bends the arm by about 1 rad [N].

    The bend per newton is the integral of y / EJ from base to anchorage, the linear part of the
    closed form. If the shortening per newton, over the arm's length, exceeds the bend in rad, the
    shortening counts.
    """
    result = list[float]()
    for i, path in arm.offset_paths:
        end = arm.sections[i].at
        s = np.linspace(0.0, end, 201)
        y = np.abs(path.evaluate(s, end)[0])
        EA, EJn, EJb, _ = arm.section_stiffness(s)[0]
        bend, shorten = np.trapezoid([y / np.minimum(EJn, EJb), 1 / EA], s)
        result.append(1 / max(float(bend), float(shorten) / arm.length))
    return np.array(result)[list(arm.offset_of)]


def effort_unit(arm: Arm) -> float:
    """Return the unit of effort for the comparison with residuals of targets [N].

    The unit depends on the arm alone, so that inactive limits do not change the compromise.
    """
    return float(NATURAL_RANGE * natural_tensions(arm).max())


def checked_limits(
    arm: Arm,
    scene: Scene,
    tension_max: Any = np.inf,
    limits: Limits | None = None,
    stroke_zero: Any = "straight",
    **_: Any,
) -> TendonLimits:
    """Return the limits from arguments of `plan`; ignore other arguments.

    Raise InputError, and the errors of `settle` if `stroke_zero` is "at rest".
    """
    given = all_limits(tension_max, limits)
    bounds = TendonLimits.of(arm, given.tension_max, given.tension_min, given.total_pull)
    bounds = bounds.with_strokes(arm, given.stroke_max, given.stroke_min)
    return replace(bounds, stroke_zero=_zeroed_at(arm, scene, stroke_zero))


def all_limits(tension_max: Any = np.inf, limits: Limits | None = None) -> Limits:
    """Return the limits with `tension_max`; raise InputError if both give the largest tension."""
    if limits is None:
        return Limits(tension_max)
    kind("limits", limits, Limits, "Limits(...), or None")
    if is_unlimited(tension_max):
        return limits
    if not is_unlimited(limits.tension_max):
        allowed = "omitted if the argument tension_max is given"
        raise InputError("limits.tension_max", limits.tension_max, allowed)
    return replace(limits, tension_max=tension_max)


def is_unlimited(tension_max: Any) -> bool:
    """Return whether the argument is the default: infinity for all tendons."""
    return isinstance(tension_max, float) and tension_max == np.inf


def _zeroed_at(arm: Arm, scene: Scene, zero: Any) -> tuple[float, ...] | None:
    """Return the lengths of the tendons at stroke 0 [m]; None for the straight arm at rest.

    See `plan`. Raise InputError if the argument is not allowed, and the errors of `settle` if the
    arm has no equilibrium in the scene without tensions.
    """
    if isinstance(zero, str) and zero == "straight":
        return None
    if isinstance(zero, str) and zero == "at rest":
        zero = settle(arm, np.zeros(arm.n_tendons), scene)
    lengths: Any = zero.tendon_lengths if isinstance(zero, Shape) and zero.arm == arm else zero
    if isinstance(lengths, str | Shape) or not isinstance(lengths, Iterable):
        allowed = '"straight", "at rest", a shape of this arm, or the lengths of its tendons [m]'
        given = Described("a shape of another arm") if isinstance(zero, Shape) else zero
        raise InputError("stroke_zero", given, allowed)
    flat = arm.flat(lengths, "stroke_zero")
    if flat.min() <= 0:
        raise InputError("stroke_zero", zero, "lengths above 0 [m]")
    return tuple(flat.tolist())
