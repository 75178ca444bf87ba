"""Frozen values: dataclasses whose arguments are checked and kept as their annotations say.

An argument is converted before the class sees it: numbers become floats within their bounds,
sequences tuples, arrays of numbers nested tuples of their shape; what is of another type is told by
InputError with the class and the argument. `__post_init__` is left with what depends on several.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cache, partial, wraps
from types import UnionType
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

from model.checks import LARGEST, finite, finite_array, kind, not_negative, positive, such
from model.errors import InputError
from model.units import likely_degrees

# Returns an argument as it is kept, from the name that it has in messages and what was given.
Convert = Callable[[str, Any], Any]
T = TypeVar("T", bound=type[Any])


@dataclass(frozen=True)
class Rule:
    """What an argument has to be besides its type, as an annotation.

    Attributes
    ----------
    apply : function
        Returns the converted argument as it is kept, from its name and itself; or InputError.
    """

    apply: Convert


@overload
def value(cls: T) -> T: ...
@overload
def value(*, init: bool = True, repr: bool = True) -> Callable[[T], T]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def value(cls: Any = None, **options: bool) -> Any:
    """Make a class a frozen dataclass that converts its arguments and remembers its hash.

    Options are those of `dataclasses.dataclass`. With init=False the class converts by itself.
    """
    if cls is None:
        return partial(value, **options)
    own_hash = "__hash__" in vars(cls)
    made = dataclass(frozen=True, **options)(cls)
    if options.get("init", True):
        _convert_first(made)
    if not own_hash:
        _remember_hash(made)
    return made


def _convert_first(cls: Any) -> None:
    """Let arguments be converted before they are assigned."""
    assign = cls.__init__
    positional = tuple(own.name for own in fields(cls) if own.init and not own.kw_only)

    @wraps(assign)
    def init(self: Any, *args: Any, **keywords: Any) -> None:
        given = dict(zip(positional, args, strict=False))
        if len(given) < len(args) or given.keys() & keywords.keys():
            assign(self, *args, **keywords)  # a TypeError, in Python's words
        converters = _converters(cls)
        for name, own in (given | keywords).items():
            if name in converters:
                label, convert = converters[name]
                own = convert(label, own)
            given[name] = own
        assign(self, **given)

    cls.__init__ = init


@cache
def _converters(cls: Any) -> dict[str, tuple[str, Convert]]:
    """Return the name in messages and the converter of each argument of a class."""
    hints = get_type_hints(cls, include_extras=True)
    return {
        own.name: (f"{cls.__name__}.{own.name}", converter(hints[own.name])) for own in fields(cls)
    }


def _remember_hash(cls: Any) -> None:
    """Let a hash be worked out once: values are looked up often.

    It does not travel with a pickle: hashes of one process mean nothing in another.
    """
    work_out, key = cls.__hash__, "_hash"

    def remembered(self: Any) -> int:
        known = self.__dict__.get(key)
        if known is None:
            known = self.__dict__[key] = work_out(self)
        return int(known)

    def state(self: Any) -> dict[str, Any]:
        return {name: own for name, own in self.__dict__.items() if name != key}

    cls.__hash__, cls.__getstate__ = remembered, state


# Converters, by annotations


def converter(hint: Any) -> Convert:
    """Return what converts arguments of an annotation; TypeError for one that says too little."""
    metadata = getattr(hint, "__metadata__", ())
    convert = _of_type(bare(hint), [own for own in metadata if isinstance(own, Meta)])
    rules = [own.apply for own in metadata if isinstance(own, Rule)]
    if not rules:
        return convert

    def ruled(name: str, given: Any) -> Any:
        given = convert(name, given)
        for rule in rules:
            given = rule(name, given)
        return given

    return ruled


def bare(hint: Any) -> Any:
    """Return a type without what it is annotated with."""
    return hint.__origin__ if get_origin(hint) is Annotated else hint


def _of_type(hint: Any, metas: list[Meta]) -> Convert:
    """Return the converter of a type, with the bounds that it is annotated with."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return _choice(inside, metas)
    if hint in (float, int):
        return _number(hint is int, metas)
    shape = _shape(hint, metas)
    if shape is not None:
        return _array(hint, shape, metas)
    if origin is tuple and inside[-1] is Ellipsis:
        return _items(inside[0], _bounds(metas, "min_length").get("min_length", 0))
    if hasattr(hint, "_fields"):
        return _named(hint)
    if origin is Literal:
        return _literal(hint, inside)
    if hint is Any:
        return lambda name, given: given
    if isinstance(hint, type):
        return lambda name, given: kind(name, given, hint)
    raise TypeError(f"{hint} does not say how it is converted")


def _bounds(metas: list[Meta], *names: str) -> dict[str, Any]:
    """Return those of several bounds that annotations have."""
    pairs = ((name, getattr(own, name)) for own in metas for name in names)
    return {name: own for name, own in pairs if own is not None}


def _choice(kinds: tuple[Any, ...], metas: list[Meta]) -> Convert:
    """Return the converter of one value, a sequence of them, or None, as far as each is allowed."""
    others = [own for own in kinds if own is not type(None)]
    several = [converter(own) for own in others if get_origin(bare(own)) is tuple]
    single = [
        converter(Annotated[own, *metas] if metas else own)
        for own in others
        if get_origin(bare(own)) is not tuple
    ]
    if len(several) > 1 or len(single) > 1:
        raise TypeError(f"which of {kinds} an argument is cannot be told")

    def convert(name: str, given: Any) -> Any:
        if given is None and len(others) < len(kinds):
            return None
        is_sequence = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str)
        if several and (is_sequence or not single):
            return several[0](name, given)
        try:
            return single[0](name, given)
        except InputError as reason:
            if not several:
                raise
            allowed = f"{reason.allowed}, or a tuple of which each is that"
            raise InputError(reason.field, reason.given, allowed) from None

    return convert


def _number(is_whole: bool, metas: list[Meta]) -> Convert:
    """Return the converter of a number within bounds."""
    bounds = _bounds(metas, "gt", "ge", "lt", "le")
    units = {(own.extra or {}).get("unit") for own in metas}
    number: Convert = partial(_bounded, bounds, "deg" in units)
    if bounds == {"gt": 0}:
        number = positive
    elif bounds == {"ge": 0}:
        number = not_negative
    if not is_whole:
        return number

    def whole(name: str, given: Any) -> int:
        found = number(name, given)
        if found != round(found):
            raise InputError(name, given, "a whole number")
        return int(found)

    return whole


_BOUNDS = {"gt": "above {}", "ge": "from {}", "lt": "below {}", "le": "up to {}"}


def _bounded(bounds: dict[str, Any], is_angle: bool, name: str, given: Any) -> float:
    """Return a number within any bounds."""
    number = finite(name, given)
    low, high = bounds.get("ge", -math.inf), bounds.get("le", math.inf)
    above, below = bounds.get("gt", -math.inf), bounds.get("lt", math.inf)
    if low <= number <= high and above < number < below:
        return number
    ends = ((_BOUNDS[key], "pi" if own == math.pi else f"{own:g}") for key, own in bounds.items())
    told = f"{'an angle in rad' if is_angle else 'a number'} "
    told += ", ".join(words.format(end) for words, end in ends)
    raise InputError(name, given, told + (likely_degrees(number) if is_angle else ""))


def _parts(hint: Any) -> tuple[list[Any], bool]:
    """Return the types inside of a tuple, and whether it is of any length."""
    if hasattr(hint, "_fields"):
        return list(get_type_hints(hint, include_extras=True).values()), False
    inside = list(get_args(hint)) if get_origin(hint) is tuple else []
    return (inside[:1], True) if inside[-1:] == [Ellipsis] else (inside, False)


def _shape(hint: Any, metas: list[Meta]) -> tuple[int | None, ...] | None:
    """Return the shape of numbers in tuples, None along what has any length; None for others."""
    if hint in (float, int):
        return ()
    parts, is_endless = _parts(hint)
    shapes = {_shape(bare(own), [*getattr(own, "__metadata__", ())]) for own in parts}
    if len(shapes) != 1 or None in shapes:
        return None
    sizes = _bounds([own for own in metas if isinstance(own, Meta)], "min_length", "max_length")
    least, most = sizes.get("min_length"), sizes.get("max_length")
    own = (most if least == most else None) if is_endless else len(parts)
    return own, *(shapes.pop() or ())


def _array(hint: Any, shape: tuple[int | None, ...], metas: list[Meta]) -> Convert:
    """Return the converter of numbers in nested tuples, each within its own bounds."""
    least = _bounds(metas, "min_length").get("min_length", 0)
    make = getattr(hint, "_make", tuple)
    leaves = _leaves(hint)
    is_whole = bare(leaves[0]) is int
    each = [converter(own) for own in leaves] if any(bare(own) != own for own in leaves) else []

    def convert(name: str, given: Any) -> Any:
        if len(shape) == 1 and not each and not is_whole and _is_kept(given, shape[0], least):
            return given
        array = finite_array(name, given, shape)
        if len(array) < least:
            raise InputError(name, given, f"at least {'one' if least == 1 else least}")
        if is_whole and not np.array_equal(array, array.astype(int)):
            raise InputError(name, given, "whole numbers")
        for i, x in enumerate(array.ravel().tolist() if each else ()):
            each[i % len(each)](name, x)
        return make(_tuples((array.astype(int) if is_whole else array).tolist()))

    return convert


def _leaves(hint: Any) -> list[Any]:
    """Return the annotations of the numbers in nested tuples, in turn."""
    parts, _ = _parts(bare(hint))
    return [leaf for own in parts for leaf in _leaves(own)] if parts else [hint]


def _is_kept(given: Any, size: int | None, least: int) -> bool:
    """Return whether numbers are a tuple of finite floats already."""
    return (
        type(given) is tuple
        and (len(given) >= least if size is None else len(given) == size)
        and all(type(own) is float and -LARGEST <= own <= LARGEST for own in given)
    )


def _tuples(nested: Any) -> Any:
    return tuple(map(_tuples, nested)) if isinstance(nested, list) else nested


def _items(hint: Any, least: int) -> Convert:
    """Return the converter of a sequence of what are no numbers."""
    each = converter(hint)

    def convert(name: str, given: Any) -> Any:
        if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray):
            raise InputError(name, given, f"a tuple of which each is {such(bare(hint))}")
        if len(given) < least:
            told = f"at least {'one' if least == 1 else least}: {such(bare(hint))}"
            raise InputError(name, given, told)
        return tuple(each(f"{name}[{i}]", own) for i, own in enumerate(given))

    return convert


def _named(hint: Any) -> Convert:
    """Return the converter of a named tuple."""
    parts, _ = _parts(hint)
    each = [(own, converter(part)) for own, part in zip(hint._fields, parts, strict=True)]

    def convert(name: str, given: Any) -> Any:
        if not isinstance(given, Sequence | np.ndarray) or len(given) != len(each):
            raise InputError(name, given, such(hint))
        pairs = zip(each, given, strict=True)
        return hint(*(part(f"{name}.{own}", x) for (own, part), x in pairs))

    return convert


def _literal(hint: Any, allowed: tuple[Any, ...]) -> Convert:
    """Return the converter of what is one of several texts or whole numbers."""

    def convert(name: str, given: Any) -> Any:
        is_one = isinstance(given, str | int | np.integer) and not isinstance(given, bool)
        if is_one and given in allowed:
            return allowed[allowed.index(given)]
        raise InputError(name, given, such(hint))

    return convert
