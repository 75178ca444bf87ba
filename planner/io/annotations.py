"""What annotations and docstrings of classes say of their arguments: units, bounds, meaning."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from msgspec import Meta

# Units of keys by their names, as powers of ten of SI's, None where they are none; and SI's.
UNITS = {"mm": -3, "mm/s": -3, "mm/s2": -3, "g": -3, "kPa": 3, "deg": None}
SI = {"mm": "m", "g": "kg", "kPa": "Pa", "deg": "rad"}


UNIONS = (Union, UnionType)
_signature = cache(inspect.signature)


def arguments(kind: Any) -> tuple[str, ...]:
    """Return the names of what a class is made of."""
    return tuple(_signature(kind).parameters)


@cache
def hints_of(kind: Any) -> dict[str, Any]:
    """Return the annotations of a class or of a table, units and bounds with them."""
    return get_type_hints(kind, include_extras=True)


def is_of_project(kind: Any) -> bool:
    """Return whether a type is a class of the project's."""
    return isinstance(kind, type) and kind.__module__.partition(".")[0] in ("model", "planner")


def is_union(kind: Any) -> bool:
    """Return whether a type is a choice of types."""
    return get_origin(kind) in UNIONS


def choice(kinds: Iterable[Any]) -> Any:
    """Return the type of what is of one of several types."""
    return Union[tuple(kinds)]  # noqa: UP007  (of types that are made here)


def metas(kind: Any) -> Iterator[Meta]:
    """Yield what annotations a type carries, from the outside in."""
    if get_origin(kind) is Annotated:
        yield from (item for item in kind.__metadata__[::-1] if isinstance(item, Meta))
        yield from metas(kind.__origin__)
    elif is_union(kind) or get_origin(kind) in (tuple, list):
        for item in get_args(kind):
            yield from metas(item)


def unit_of_type(kind: Any) -> str:
    """Return the unit that the annotations of a type name; empty without one."""
    named = (item.extra["unit"] for item in metas(kind) if item.extra and item.extra.get("unit"))
    return next(named, "")


def about_type(kind: Any) -> str:
    """Return what the annotations of a key's type say that it holds."""
    return next((item.description for item in metas(kind) if item.description), "")


def quantity(about: str, unit: str = "", **bounds: Any) -> Meta:
    """Return the annotation of a key: what it holds, and its unit."""
    text = f"{about} [{unit}]".strip() if unit else about
    return Meta(description=text, extra={"unit": unit}, **bounds)


def suffix(unit: str) -> str:
    """Return the end of the keys of a unit; SI's have none."""
    return f"_{unit.replace('/', '_')}" if unit in UNITS else ""


def sentence(kind: Any) -> str:
    """Return the first sentence of a class's docstring, as it stands behind a key."""
    text = " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())
    return re.split(r"\. (?=[A-Z])", text)[0].removesuffix(".")


# How keys end, and the units of their numbers.
ENDS = {"": "", **{suffix(unit): unit for unit in UNITS}}


@cache
def attributes_told(kind: Any) -> dict[str, str]:
    """Return what the docstring of a class says of each of its attributes."""
    result: dict[str, str] = {}
    names: list[str] = []
    _, _, rest = (inspect.getdoc(kind) or "").partition("Attributes\n----------\n")
    for line in rest.splitlines():
        if line and not line.startswith(" "):
            names = line.partition(" : ")[0].split(", ")
            continue
        for name in names:
            result[name] = f"{result.get(name, '')} {line.strip()}".strip()
    return {name: item.removesuffix(".") for name, item in result.items()}
