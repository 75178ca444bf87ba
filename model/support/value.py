"""Frozen values: dataclasses that check and convert arguments by annotations of quantities.

Arguments are converted before `__post_init__`: numbers to floats within bounds, sequences to
tuples, arrays of numbers to nested tuples of a given shape. Arguments of another type raise
InputError with the class and the argument. `__post_init__` checks relations between arguments.

The annotations of quantities are types, bounds, and units in files. Values are stored in SI units,
and bounds are in SI units. `octoplan.planner.frontends.io` derives keys, checks, schema and
documentation of files from the annotations, so that each argument is defined once, in its class.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cache, partial
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
    overload,
)

import numpy as np
from msgspec import Meta

from octoplan.model.support.checks import (
    SUCH,
    finite,
    finite_array,
    flag,
    is_several,
    kind,
    literal,
    not_negative,
    orthonormal,
    positive,
    such,
    unit_vector,
)
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import likely_degrees

# Converts an argument, from the name in messages and the value.
Convert = Callable[[str, Any], Any]
# Bounds of numbers and sizes, by the names of Meta's arguments.
Bounds = dict[str, Any]
T = TypeVar("T", bound=type[Any])


@dataclass(frozen=True)
class Rule:
    """Condition of an argument in addition to its type, as an annotation.

    Attributes
    ----------
    apply : function
        Returns the final argument from the name and the converted value, or raises InputError.
    is_first : bool
        Whether `apply` gets the given value instead, and its result is converted.
    """

    apply: Convert
    is_first: bool = False


@overload
def value(cls: T) -> T: ...
@overload
def value(*, init: bool = True, repr: bool = True) -> Callable[[T], T]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def value(cls: Any = None, **options: bool) -> Any:
    """Make a class a frozen dataclass that converts its arguments and caches its hash.

    Options are the ones of `dataclasses.dataclass`. With init=False the class must
    convert its arguments on its own.
    """
    if cls is None:
        return partial(value, **options)
    check_together = getattr(cls, "__post_init__", None)

    def convert_first(self: Any) -> None:
        if self.__class__ is made:
            for name, default, label, convert in _converters(made):
                if vars(self)[name] is not default:
                    vars(self)[name] = convert(label, vars(self)[name])
        if check_together:
            check_together(self)

    cls.__post_init__ = convert_first
    own_hash = "__hash__" in vars(cls)
    made: Any = dataclass(frozen=True, **options)(cls)
    if not own_hash:
        _remember_hash(made)
    return made


@cache
def _converters(cls: Any) -> list[tuple[str, Any, str, Convert]]:
    """Return the name, default, name in messages, and converter of each argument of a class."""
    hints = get_type_hints(cls, include_extras=True)
    return [
        (each.name, each.default, f"{cls.__name__}.{each.name}", converter(hints[each.name]))
        for each in fields(cls)
    ]


def _remember_hash(cls: Any) -> None:
    """Cache the hash of instances, which are often used as keys.

    The cache is not pickled, because hashes differ between processes.
    """
    compute = cls.__hash__
    key = "_hash"

    def remembered(self: Any) -> int:
        if key not in vars(self):
            vars(self)[key] = compute(self)
        return int(vars(self)[key])

    def state(self: Any) -> dict[str, Any]:
        return {name: each for name, each in vars(self).items() if name != key}

    cls.__hash__ = remembered
    cls.__getstate__ = state


# Converters by annotation


def converter(hint: Any, outer: Bounds | None = None) -> Convert:
    """Return the converter of an annotation; TypeError if the annotation is insufficient.

    The bounds of a union, `outer`, apply to its members.
    """
    bounds = (outer or {}) | _bounds(hint)
    rules = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Rule)]
    convert = _of_type(bare(hint), bounds)
    first = [rule.apply for rule in rules if rule.is_first]
    last = [rule.apply for rule in rules if not rule.is_first]

    def ruled(name: str, argument: Any) -> Any:
        for step in (*first, convert, *last):
            argument = step(name, argument)
        return argument

    return ruled if rules else convert


def bare(hint: Any) -> Any:
    """Return a type without its annotations."""
    return hint.__origin__ if get_origin(hint) is Annotated else hint


def _bounds(hint: Any) -> Bounds:
    """Return the bounds of a number or a size from annotations, and whether it is an angle."""
    metas = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Meta)]
    names = ("gt", "ge", "lt", "le", "min_length", "max_length")
    pairs = [(name, getattr(meta, name)) for meta in metas for name in names]
    bounds = {name: each for name, each in pairs if each is not None}
    is_angle = any((meta.extra or {}).get("unit") == "deg" for meta in metas)
    return bounds | ({"angle": True} if is_angle else {})


def _of_type(hint: Any, bounds: Bounds) -> Convert:
    """Return the converter of a type with bounds."""
    origin = get_origin(hint)
    inside = get_args(hint)
    if origin in (Union, UnionType):
        return _choice(inside, bounds)
    if hint in (float, int):
        return _number(hint, bounds)
    numbers = _numbers(hint, bounds)
    if numbers is not None:
        return _array(hint, *numbers, bounds.get("min_length", 0))
    if origin is tuple or hasattr(hint, "_fields"):
        return _items(hint, bounds.get("min_length", 0))
    if origin is Literal:
        return partial(literal, wanted=hint)
    if hint is bool:
        return flag
    if hint is Any:
        return lambda name, argument: argument
    if isinstance(hint, type):
        return lambda name, inputs: kind(name, inputs, hint)
    raise TypeError(f"{hint} does not say how it is converted")


def _choice(kinds: tuple[Any, ...], bounds: Bounds) -> Convert:
    """Return the converter of a union of a value, a sequence of values, and None."""
    others = [each for each in kinds if each is not NoneType]
    by_form = {get_origin(bare(each)) is tuple: converter(each, bounds) for each in others}
    if len(by_form) < len(others):
        raise TypeError(f"which of {kinds} an argument is cannot be told")
    several = by_form.get(True)
    single = by_form.get(False)

    def convert(name: str, argument: Any) -> Any:
        if argument is None and NoneType in kinds:
            return None
        if several and (single is None or is_several(argument)):
            return several(name, argument)
        assert single is not None
        try:
            return single(name, argument)
        except InputError as reason:
            if not several:
                raise
            allowed = f"{reason.allowed}, or a tuple of these"
            raise InputError(reason.field, reason.given, allowed) from None

    return convert


_BOUNDS = {"gt": "above {}", "ge": "from {}", "lt": "below {}", "le": "up to {}"}


def _number(hint: Any, bounds: Bounds) -> Convert:
    """Return the converter of a float or an integer within bounds."""
    ends = {key: each for key, each in bounds.items() if key in _BOUNDS}
    number: Convert = partial(_bounded, ends, "angle" in bounds)
    if ends in ({"gt": 0}, {"ge": 0}):
        number = positive if "gt" in ends else not_negative

    def whole(name: str, argument: Any) -> int:
        result = number(name, argument)
        if result != round(result):
            raise InputError(name, argument, "a whole number")
        return int(result)

    return whole if hint is int else number


def _bounded(ends: Bounds, is_angle: bool, name: str, argument: Any) -> float:
    """Return a number within its bounds, or raise InputError."""
    number = finite(name, argument)
    low = ends.get("ge", -math.inf)
    high = ends.get("le", math.inf)
    if low <= number <= high and ends.get("gt", -math.inf) < number < ends.get("lt", math.inf):
        return number
    names = ((_BOUNDS[key], "pi" if each == math.pi else f"{each:g}") for key, each in ends.items())
    message = f"{'an angle in rad' if is_angle else 'a number'} "
    message += ", ".join(words.format(end) for words, end in names)
    raise InputError(name, argument, message + (likely_degrees(number) if is_angle else ""))


def _parts(hint: Any) -> tuple[list[Any], bool]:
    """Return the annotations of a tuple's items, and whether the tuple may have any length."""
    if hasattr(hint, "_fields"):
        return list(get_type_hints(hint, include_extras=True).values()), False
    inside = list(get_args(hint)) if get_origin(hint) is tuple else []
    return (inside[:1], True) if inside[-1:] == [Ellipsis] else (inside, False)


def _numbers(hint: Any, bounds: Bounds) -> tuple[tuple[int | None, ...], list[Any]] | None:
    """Return the shape of nested tuples of numbers, and their annotations; None for other types.

    The shape has None for any length.
    """
    parts, is_endless = _parts(hint)
    inner = [
        ((), [part]) if bare(part) in (float, int) else _numbers(bare(part), _bounds(part))
        for part in parts
    ]
    shapes = {None if each is None else each[0] for each in inner}
    if len(shapes) != 1 or None in shapes:
        return None
    least = bounds.get("min_length")
    most = bounds.get("max_length")
    count = (most if least == most else None) if is_endless else len(parts)
    return (count, *(shapes.pop() or ())), [leaf for each in inner if each for leaf in each[1]]


def _array(hint: Any, shape: tuple[int | None, ...], leaves: list[Any], least: int) -> Convert:
    """Return the converter of nested tuples of numbers, each within its bounds."""
    make = getattr(hint, "_make", tuple)
    is_whole = bare(leaves[0]) is int
    each = [converter(leaf) for leaf in leaves if any(map(_bounds, leaves))]

    def convert(name: str, argument: Any) -> Any:
        array = finite_array(name, argument, shape)
        if len(array) < least:
            raise InputError(name, argument, f"at least {'one' if least == 1 else least}")
        if is_whole and not np.array_equal(array, array.astype(int)):
            raise InputError(name, argument, "whole numbers")
        for i, x in enumerate(array.ravel().tolist() if each else ()):
            each[i % len(each)](name, x)
        return make(_tuples((array.astype(int) if is_whole else array).tolist()))

    return convert


def _tuples(nested: Any) -> Any:
    return tuple(map(_tuples, nested)) if isinstance(nested, list) else nested


def _items(hint: Any, least: int) -> Convert:
    """Return the converter of a tuple or a sequence with items that are not only numbers."""
    parts, is_endless = _parts(hint)
    each = [converter(part) for part in parts]
    allowed = f"a tuple, each item {such(bare(parts[0]))}" if is_endless else such(hint)

    def convert(name: str, argument: Any) -> Any:
        if not is_several(argument) or not (is_endless or len(argument) == len(parts)):
            raise InputError(name, argument, allowed)
        if len(argument) < least:
            message = f"at least {'one' if least == 1 else least}: {such(bare(parts[0]))}"
            raise InputError(name, argument, message)
        if is_endless:
            return tuple(each[0](f"{name}[{i}]", item) for i, item in enumerate(argument))
        ends = [f".{item}" for item in getattr(hint, "_fields", ())]
        ends = ends or [f"[{i}]" for i in range(len(each))]
        rows = zip(ends, each, argument, strict=True)
        items = [convert(f"{name}{end}", x) for end, convert, x in rows]
        return hint(*items) if hasattr(hint, "_fields") else tuple(items)

    return convert


# Annotations of quantities. Values and bounds are in SI units, units of files are named.


def unit(name: str, **bounds: Any) -> Meta:
    """Return the annotation of a quantity: its unit in files, and other arguments of Meta."""
    return Meta(extra={"unit": name}, **bounds)


Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Sign = Literal[1, -1]
Count = Annotated[int, Meta(ge=0)]
Corners = Annotated[tuple[int, ...], Meta(min_length=3, max_length=3)]
Vector = Annotated[tuple[float, ...], Meta(min_length=3, max_length=3)]
Direction = Annotated[Vector, Rule(unit_vector)]
Matrix = Annotated[tuple[Vector, ...], Meta(min_length=3, max_length=3)]
Frame = Annotated[Matrix, Rule(orthonormal)]
Axes = Annotated[Matrix, Rule(partial(orthonormal, right_handed=False))]
SUCH[Sign] = "1 (pulling in) or -1 (paying out)"

Length = Annotated[Positive, unit("mm")]
ArcLength = Annotated[NotNegative, unit("mm")]
Guides = Annotated[tuple[ArcLength, ...], Meta(max_length=1000)]
Place = Annotated[Vector, unit("mm")]
Sizes = Annotated[tuple[Positive, ...], unit("mm", min_length=3, max_length=3)]
Angle = Annotated[float, unit("deg")]
Density = Annotated[NotNegative, unit("kg/m3")]
Force = Annotated[Vector, unit("N")]
# Axial stiffness E A of tendons whose lengths are held.
Tension = Annotated[Positive, unit("N")]
Stiffness = Annotated[Positive, unit("N/m")]
