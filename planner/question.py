"""A planning question: how it is stated, what the tendons may do, and checks of what is asked."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args

import numpy as np
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import FINEST
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import checked_scene, settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import LARGEST, finite_array, is_several, numbers
from octoplan.model.support.errors import InputError
from octoplan.model.support.quantities import Count
from octoplan.model.support.units import LARGEST_LIMIT, SMALLEST_LIMIT, STROKE, warn_unusual
from octoplan.planner.program.terms import Targets
from octoplan.planner.targets.base import Target

Norm = Literal["2", "1", "inf"]
Mode = Literal["exact", "closest", "nearest"]
# Tensions of plans over those that bend the arm by 1 rad: the range in which most of them are.
NATURAL_RANGE = 5.0


def effort(tensions: Array, norm: Norm) -> Array:
    """Return the norms (...) of tensions (..., n_tendons) [N]."""
    return np.asarray(np.linalg.norm(tensions, float(norm), axis=-1))


@dataclass(frozen=True)
class Statement:
    """The choices that the program's functions depend on.

    Attributes
    ----------
    norm : "2", "1" or "inf"
        What effort is.
    mode : "exact", "closest" or "nearest"
        How the targets are read, see octoplan.planner.program.program.
    refinement : int
        Of the mesh, whose elements have three Gauss stages.
    margin : float
        The least stability that is accepted, see octoplan.planner.certificate.
    modes : int
        How many of the least stable modes are held to it; none where stability is only checked.
    floor : float
        What these are held to at least: an arm that is about to yield does not settle.
    iterations : int
        Of a plan, how many its solution took on the last mesh.
    """

    norm: Norm = "2"
    mode: Mode = "exact"
    refinement: Annotated[int, Meta(ge=1, le=FINEST)] = 4
    margin: float = 0.0
    modes: Annotated[int, Meta(ge=0, le=1)] = 0
    floor: float = 1e-2
    iterations: Count = 0

    @property
    def least(self) -> float:
        """The stability that modes are held to."""
        return max(self.margin, self.floor)

    def but(self, **changes: Any) -> Statement:
        """Return the statement with some choices changed."""
        return replace(self, **changes)


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
        if np.isinf(low).any():
            raise InputError("tension_min", lower, "finite numbers")
        with np.errstate(over="ignore"):
            shares = high / natural_tensions(arm)
        warn_unusual("tension_max", [float(shares.max())], LARGEST_LIMIT)
        warn_unusual("tension_max", [float(shares.min())], SMALLEST_LIMIT)
        # Minima above a million times what bends the arm crush any arm, and digits are lost.
        times = "up to {:g} N, 1e+06 times what bends the arm by 1 rad"
        bounds = (1e6 * natural_tensions(arm), times), (high, "up to its maximum, {:g} N")
        for most, allowed in bounds:
            for j in np.flatnonzero(low > most)[:1].tolist():
                name = f"tension_min[{j}] ({arm.tendon_name(j)})"
                raise InputError(name, float(low[j]), allowed.format(most[j]))
        # The sum is off by rounding.
        least = low.sum() * (1 - 1e-9)
        if total is not None and float(finite_array("total_pull", total, ())) < least:
            raise InputError("total_pull", total, f"{low.sum():g} N, the sum of minima, or above")
        return cls(tuple(high.tolist()), tuple(low.tolist()), total)

    def with_strokes(self, arm: Arm, most: Any, least: Any = None) -> Limits:
        """Return the limits with those of strokes, as `plan` takes them; None for no limits.

        Raises InputError for a most below or a least above 0, where the arm rests.
        """
        if most is None and least is None:
            return self
        high = each_tendon(arm, "stroke_max", np.inf if most is None else most)
        warn_unusual("stroke_max", (high / arm.length).tolist(), STROKE)
        paid_out = high
        if least is not None:
            allowed = "0 or a number below it, or one for each tendon"
            negative = numbers("stroke_min", least, allowed)
            if not np.all(negative <= 0):
                raise InputError("stroke_min", least, allowed)
            paid_out = each_tendon(arm, "stroke_min", np.abs(negative))
            warn_unusual("stroke_min", (paid_out / arm.length).tolist(), STROKE)
        return replace(self, strokes=(tuple((0.0 - paid_out).tolist()), tuple(high.tolist())))

    def of_tendons(self, pulling: Collection[int]) -> Limits:
        """Return the limits with tendons that are not to pull held at their minima."""
        both = enumerate(zip(self.lower, self.upper, strict=True))
        upper = tuple(most if j in pulling else least for j, (least, most) in both)
        return replace(self, upper=upper)

    @property
    def keywords(self) -> dict[str, Any]:
        """The limits as keywords of `plan`."""
        least, most = self.strokes or (None, None)
        return {
            "tension_min": np.array(self.lower),
            "tension_max": np.array(self.upper),
            "total_pull": self.total,
            "stroke_min": least,
            "stroke_max": most,
            "stroke_zero": "straight" if self.stroke_zero is None else self.stroke_zero,
        }


def each_tendon(arm: Arm, name: str, values: Any) -> Array:
    """Return numbers (n_tendons,) of 0 or above; InputError for what is no such number."""
    if not is_several(values):
        number = float(numbers(name, values, "a number, or one for each tendon"))
        if not number >= 0:
            raise InputError(name, values, "0 or a number above it")
        return np.full(arm.n_tendons, number)
    flat = arm.flat(_finite(values), name)
    return np.where(flat >= LARGEST, np.inf, flat)


def _finite(values: Any) -> Any:
    """Return numbers in rows with the largest one for infinity; the arm judges all else."""
    if is_several(values):
        return [_finite(value) for value in values]
    return LARGEST if isinstance(values, float) and values == np.inf else values


@lru_cache(maxsize=64)
def natural_tensions(arm: Arm) -> Array:
    """Return for each tendon about the tension that bends the arm by 1 rad on its own [N].

    From the integral of y / EJ to its anchorage: the linear part of the closed form.
    """
    result = list[float]()
    for i, path in arm.offset_paths:
        end = arm.sections[i].at
        s = np.linspace(0.0, end, 201)
        y, R = np.abs(path.evaluate(s, end)[0]), arm.radius.evaluate(s, arm.length)[0]
        EA = arm.material.E * np.pi * R**2
        bend, shorten = np.trapezoid([4 * y / (EA * R**2), 1 / EA], s)
        result.append(1 / max(float(bend), float(shorten) / arm.length))
    return np.array(result)[list(arm.offset_of)]


def effort_unit(arm: Arm) -> float:
    """Return the tension in units of which effort is weighed against missed targets [N].

    It depends on the arm alone, so that limits that are not active change no compromise.
    """
    return float(NATURAL_RANGE * natural_tensions(arm).max())


def planned_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, that of the bare arm for None; InputError where no plans are made in it."""
    scene = checked_scene(arm, scene, contact=True)
    if scene.has(PrintedStatics):
        allowed = (
            "a scene whose statics are consistent, such as Scene(Extension()); settle takes it"
        )
        raise InputError("scene", "written as printed", allowed)
    return scene


def checked_limits(
    arm: Arm,
    scene: Scene,
    tension_max: Any = np.inf,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    stroke_max: Any = None,
    stroke_min: Any = None,
    stroke_zero: Any = "straight",
    **_: Any,
) -> Limits:
    """Return the limits from arguments of plan, of which others may be there too.

    Raises InputError, and as settle does where winches are zeroed "at rest".
    """
    limits = Limits.of(arm, tension_max, tension_min, total_pull)
    limits = limits.with_strokes(arm, stroke_max, stroke_min)
    return replace(limits, stroke_zero=_zeroed_at(arm, scene, stroke_zero))


def _zeroed_at(arm: Arm, scene: Scene, zero: Any) -> tuple[float, ...] | None:
    """Return the tendons' lengths where winches are zeroed [m]; None at the straight arm at rest.

    See plan. Raises InputError for what is not allowed, and as settle does where the arm does not
    stand in the scene without tensions.
    """
    if isinstance(zero, str) and zero == "straight":
        return None
    if isinstance(zero, str) and zero == "at rest":
        zero = settle(arm, np.zeros(arm.n_tendons), scene)
    lengths: Any = zero.tendon_lengths if isinstance(zero, Shape) and zero.arm == arm else zero
    if isinstance(lengths, str | Shape) or not isinstance(lengths, Iterable):
        allowed = '"straight", "at rest", a shape of this arm, or the lengths of its tendons [m]'
        given = "of another arm" if isinstance(zero, Shape) else zero
        raise InputError("stroke_zero", given, allowed)
    flat = arm.flat(lengths, "stroke_zero")
    if flat.min() <= 0:
        raise InputError("stroke_zero", zero, "lengths above 0 [m]")
    return tuple(flat.tolist())


def stated(targets: tuple[Target, ...], limits: Limits, norm: Any, starts: Any) -> Statement:
    """Return the statement that arguments of plan ask for; InputError for what is not allowed."""
    endless = limits.total is None and bool(np.isinf(limits.upper).any())
    whole = type(starts) is int and starts >= 1
    norms = "2 (least squares), 1 (least total pull) or inf"
    checks = (
        (
            not (endless and any(target.compliance_request() for target in targets)),
            ("tension_max", np.inf, "finite limits where a stiffness is wanted"),
        ),
        (str(norm) in get_args(Norm), ("norm", norm, f"{norms} (least maximum)")),
        (starts is None or whole, ("starts", starts, "a whole number from 1")),
    )
    for is_allowed, what in checks:
        if not is_allowed:
            raise InputError(*what)
    return Statement(str(norm))  # type: ignore[arg-type]


def check_targets(arm: Arm, target: Target | Iterable[Target]) -> tuple[Target, ...]:
    """Return copies of the targets; InputError for misfits and contradictions.

    Plans keep the copies, so that changes of the given objects do not change what was asked.
    """
    targets = tuple(target) if isinstance(target, tuple | list) else (target,)
    if not targets:
        raise InputError("target", target, "at least one target")
    prescribed = dict[str, int]()
    copies = list[Target]()
    for i, t in enumerate(targets):
        if not isinstance(t, Target):
            raise InputError("target", t, "a target such as TipPosition(...)")
        t.check(arm)
        try:
            copies.append(deepcopy(t))
        except Exception as reason:
            allowed = f"a target that copy.deepcopy copies: {reason}"
            raise InputError("target", type(t).__name__, allowed) from reason
        for name in t.prescribed(arm):
            if name in prescribed:
                allowed = f"one target for it, not two: targets[{prescribed[name]}] prescribes it"
                raise InputError(f"targets[{i}]", f"another {name}", allowed)
            prescribed[name] = i
    if not Targets(arm, targets).tendons:
        raise InputError(
            "target", targets, "targets that leave some tendon to pull for all of them"
        )
    return tuple(copies)
