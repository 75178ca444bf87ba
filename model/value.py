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
    positional = tuple(each.name for each in fields(cls) if each.init and not each.kw_only)

    @wraps(assign)
    def init(self: Any, *args: Any, **keywords: Any) -> None:
        arguments = dict(zip(positional, args, strict=False))
        if len(arguments) < len(args) or arguments.keys() & keywords.keys():
            assign(self, *args, **keywords)  # a TypeError, in Python's words
        converters = _converters(cls)
        for name, each in (arguments | keywords).items():
            if name in converters:
                label, convert = converters[name]
                each = convert(label, each)
            arguments[name] = each
        assign(self, **arguments)

    cls.__init__ = init


@cache
def _converters(cls: Any) -> dict[str, tuple[str, Convert]]:
    """Return the name in messages and the converter of each argument of a class."""
    hints = get_type_hints(cls, include_extras=True)
    return {
        each.name: (f"{cls.__name__}.{each.name}", converter(hints[each.name]))
        for each in fields(cls)
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
        return {name: each for name, each in self.__dict__.items() if name != key}

    cls.__hash__, cls.__getstate__ = remembered, state


# Converters, by annotations


def converter(hint: Any) -> Convert:
    """Return what converts arguments of an annotation; TypeError for one that says too little."""
    metadata = getattr(hint, "__metadata__", ())
    convert = _of_type(bare(hint), [each for each in metadata if isinstance(each, Meta)])
    rules = [each.apply for each in metadata if isinstance(each, Rule)]
    if not rules:
        return convert

    def ruled(name: str, argument: Any) -> Any:
        argument = convert(name, argument)
        for rule in rules:
            argument = rule(name, argument)
        return argument

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
        return lambda name, argument: argument
    if isinstance(hint, type):
        return lambda name, inputs: kind(name, inputs, hint)
    raise TypeError(f"{hint} does not say how it is converted")


def _bounds(metas: list[Meta], *names: str) -> dict[str, Any]:
    """Return those of several bounds that annotations have."""
    pairs = ((name, getattr(meta, name)) for meta in metas for name in names)
    return {name: each for name, each in pairs if each is not None}


def _choice(kinds: tuple[Any, ...], metas: list[Meta]) -> Convert:
    """Return the converter of one value, a sequence of them, or None, as far as each is allowed."""
    others = [each for each in kinds if each is not type(None)]
    several = [converter(other) for other in others if get_origin(bare(other)) is tuple]
    single = [
        converter(Annotated[other, *metas] if metas else other)
        for other in others
        if get_origin(bare(other)) is not tuple
    ]
    if len(several) > 1 or len(single) > 1:
        raise TypeError(f"which of {kinds} an argument is cannot be told")

    def convert(name: str, argument: Any) -> Any:
        if argument is None and len(others) < len(kinds):
            return None
        is_sequence = isinstance(argument, Sequence | np.ndarray) and not isinstance(argument, str)
        if several and (is_sequence or not single):
            return several[0](name, argument)
        try:
            return single[0](name, argument)
        except InputError as reason:
            if not several:
                raise
            allowed = f"{reason.allowed}, or a tuple of which each is that"
            raise InputError(reason.field, reason.given, allowed) from None

    return convert


def _number(is_whole: bool, metas: list[Meta]) -> Convert:
    """Return the converter of a number within bounds."""
    bounds = _bounds(metas, "gt", "ge", "lt", "le")
    units = {(meta.extra or {}).get("unit") for meta in metas}
    number: Convert = partial(_bounded, bounds, "deg" in units)
    if bounds == {"gt": 0}:
        number = positive
    elif bounds == {"ge": 0}:
        number = not_negative
    if not is_whole:
        return number

    def whole(name: str, argument: Any) -> int:
        result = number(name, argument)
        if result != round(result):
            raise InputError(name, argument, "a whole number")
        return int(result)

    return whole


_BOUNDS = {"gt": "above {}", "ge": "from {}", "lt": "below {}", "le": "up to {}"}


def _bounded(bounds: dict[str, Any], is_angle: bool, name: str, argument: Any) -> float:
    """Return a number within any bounds."""
    number = finite(name, argument)
    low, high = bounds.get("ge", -math.inf), bounds.get("le", math.inf)
    above, below = bounds.get("gt", -math.inf), bounds.get("lt", math.inf)
    if low <= number <= high and above < number < below:
        return number
    ends = (
        (_BOUNDS[key], "pi" if each == math.pi else f"{each:g}") for key, each in bounds.items()
    )
    message = f"{'an angle in rad' if is_angle else 'a number'} "
    message += ", ".join(words.format(end) for words, end in ends)
    raise InputError(name, argument, message + (likely_degrees(number) if is_angle else ""))


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
    shapes = {_shape(bare(part), [*getattr(part, "__metadata__", ())]) for part in parts}
    if len(shapes) != 1 or None in shapes:
        return None
    sizes = _bounds([meta for meta in metas if isinstance(meta, Meta)], "min_length", "max_length")
    least, most = sizes.get("min_length"), sizes.get("max_length")
    values = (most if least == most else None) if is_endless else len(parts)
    return values, *(shapes.pop() or ())


def _array(hint: Any, shape: tuple[int | None, ...], metas: list[Meta]) -> Convert:
    """Return the converter of numbers in nested tuples, each within its own bounds."""
    least = _bounds(metas, "min_length").get("min_length", 0)
    make = getattr(hint, "_make", tuple)
    leaves = _leaves(hint)
    is_whole = bare(leaves[0]) is int
    each = (
        [converter(leaf) for leaf in leaves] if any(bare(leaf) != leaf for leaf in leaves) else []
    )

    def convert(name: str, argument: Any) -> Any:
        if len(shape) == 1 and not each and not is_whole and _is_kept(argument, shape[0], least):
            return argument
        array = finite_array(name, argument, shape)
        if len(array) < least:
            raise InputError(name, argument, f"at least {'one' if least == 1 else least}")
        if is_whole and not np.array_equal(array, array.astype(int)):
            raise InputError(name, argument, "whole numbers")
        for i, x in enumerate(array.ravel().tolist() if each else ()):
            each[i % len(each)](name, x)
        return make(_tuples((array.astype(int) if is_whole else array).tolist()))

    return convert


def _leaves(hint: Any) -> list[Any]:
    """Return the annotations of the numbers in nested tuples, in turn."""
    parts, _ = _parts(bare(hint))
    return [leaf for part in parts for leaf in _leaves(part)] if parts else [hint]


def _is_kept(argument: Any, size: int | None, least: int) -> bool:
    """Return whether numbers are a tuple of finite floats already."""
    return (
        type(argument) is tuple
        and (len(argument) >= least if size is None else len(argument) == size)
        and all(type(each) is float and -LARGEST <= each <= LARGEST for each in argument)
    )


def _tuples(nested: Any) -> Any:
    return tuple(map(_tuples, nested)) if isinstance(nested, list) else nested


def _items(hint: Any, least: int) -> Convert:
    """Return the converter of a sequence of what are no numbers."""
    each = converter(hint)

    def convert(name: str, argument: Any) -> Any:
        if isinstance(argument, str) or not isinstance(argument, Sequence | np.ndarray):
            raise InputError(name, argument, f"a tuple of which each is {such(bare(hint))}")
        if len(argument) < least:
            message = f"at least {'one' if least == 1 else least}: {such(bare(hint))}"
            raise InputError(name, argument, message)
        return tuple(each(f"{name}[{i}]", item) for i, item in enumerate(argument))

    return convert


def _named(hint: Any) -> Convert:
    """Return the converter of a named tuple."""
    parts, _ = _parts(hint)
    each = [(item, converter(part)) for item, part in zip(hint._fields, parts, strict=True)]

    def convert(name: str, argument: Any) -> Any:
        if not isinstance(argument, Sequence | np.ndarray) or len(argument) != len(each):
            raise InputError(name, argument, such(hint))
        pairs = zip(each, argument, strict=True)
        return hint(*(part(f"{name}.{item}", x) for (item, part), x in pairs))

    return convert


def _literal(hint: Any, allowed: tuple[Any, ...]) -> Convert:
    """Return the converter of what is one of several texts or whole numbers."""

    def convert(name: str, argument: Any) -> Any:
        is_one = isinstance(argument, str | int | np.integer) and not isinstance(argument, bool)
        if is_one and argument in allowed:
            return allowed[allowed.index(argument)]
        raise InputError(name, argument, such(hint))

    return convert
