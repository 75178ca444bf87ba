"""Derive the msgspec types of files from the classes of the project.

`table` returns the struct of a class for scene files: one key per argument, with the unit of the
annotation as suffix, bounds, default and the description in the docstring of the class. An
argument whose annotation has no such type requires a `FieldFormat`; otherwise the import fails with
the name of the argument. `exact` returns the struct of a class for saved plans and calibrations: SI
numbers under the names of the arguments, and the class under `kind`. `unit=None` selects the exact
form.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Container, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
from msgspec import UNSET, Meta, UnsetType

from octoplan.model.paths import Array, Linear, Path
from octoplan.planner.frontends.io.codec import (
    INTERPOLATIONS,
    KEYS,
    PLACED,
    READ,
    SI,
    WRITE,
    FieldFormat,
    Table,
    about_type,
    arguments_of,
    choice,
    encode,
    hints_of,
    is_of_project,
    is_union,
    keys_of,
    number_in,
    quantity,
    read_exact,
    sample_keys,
    suffix,
    unit_of_type,
)

_BOUNDS = ("gt", "ge", "lt", "le")
_LENGTHS = ("min_length", "max_length")

Accuracy = Annotated[float, Meta(ge=1e-12, le=0.1)]
Tensions = list[list[float] | float]
# Numbers in the exact form: JSON has no infinities and no NaN.
Number = float | Literal["inf", "-inf", "nan"]
# The type of a key for each class: a table or a union of tables.
TABLES: dict[Any, Any] = {}


def struct(
    name: str,
    fields: list[Any],
    doc: str | None = "",
    tag: str | None = None,
    base: type[msgspec.Struct] = Table,
    **config: Any,
) -> Any:
    """Return a struct with fields (name, type) or (name, type, default)."""
    config = {"kw_only": True, "frozen": True, **config}
    space = {"__doc__": doc}
    return msgspec.defstruct(name, fields, bases=(base,), namespace=space, tag=tag, **config)


def _samples(name: str, unit: str) -> Any:
    """Return the table of a function of arc length given by samples with a unit."""
    about = ("arc lengths from the base", "mm"), ("values at these arc lengths", unit)
    fields: list[Any] = [
        (key, Annotated[list[float], quantity(*item, min_length=2)])
        for key, item in zip(sample_keys(unit), about, strict=True)
    ]
    between = "cubic spline through at least four samples, or straight lines with kinks"
    choices: Any = Literal[tuple(INTERPOLATIONS)]
    fields.append(("interpolation", Annotated[choices, quantity(between)], "spline"))
    doc = "A function of arc length through samples."
    return struct(f"{name}Samples", fields, doc)


_NAMES = {
    "mm": "Length",
    "deg": "Angle",
    "1/m": "Curvature",
    "N": "AxialStiffness",
    "N m2": "Rigidity",
}
SAMPLES: dict[str, Any] = {unit: _samples(name, unit) for unit, name in _NAMES.items()}


def table(
    kind: Any,
    *,
    tag: str | None = None,
    more: Mapping[str, Any] | None = None,
    **forms: FieldFormat,
) -> type[Table]:
    """Return the table of a class; raise TypeError for an argument without a key.

    Parameters
    ----------
    kind : type
        The class; the arguments define the keys. With `more` keys, all arguments are optional.
    tag : str
        Value of the key `type`, which distinguishes the table from others.
    more : mapping
        Keys that are not arguments, with types and defaults.
    **forms : FieldFormat
        Formats of arguments that occupy other keys.
    """
    fields: list[Any] = [(key, *item) for key, item in (more or {}).items()]
    own_keys: dict[str, str] = {}
    for name, type_, default in fields_of(kind, skip=forms):
        own_keys[name] = name + suffix(unit_of_type(type_))
        left_out = default is inspect.Parameter.empty and more is not None
        held = (type_ | None, None) if left_out else (type_, default)
        fields.append(
            (own_keys[name], *(item for item in held if item is not inspect.Parameter.empty))
        )
    for form in forms.values():
        fields += [(key, type_, *default) for key, (type_, *default) in form.keys.items()]
    new_table: type[Table] = struct(f"{kind.__name__}Table", fields, f"See {kind.__name__}.", tag)
    KEYS[new_table] = own_keys, hints_of(kind), forms
    READ[new_table] = lambda arguments: kind(**arguments_of(arguments, new_table))
    WRITE[kind] = lambda value: keys_of(value, new_table)
    return new_table


def fields_of(kind: Any, skip: Container[str] = ()) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, type in files and default in files of each argument of a class."""
    descriptions = attribute_descriptions(kind)
    for name, argument in inspect.signature(kind).parameters.items():
        if name in skip:
            continue
        hint = hints_of(kind).get(name)
        default = argument.default
        unit = unit_of_type(hint)
        try:
            held = type_in_file(hint)
        except TypeError as reason:
            raise TypeError(f"{kind.__name__}.{name} has no key: {reason}") from None
        about = descriptions.get(name, "").replace(f"[{SI.get(unit)}]", f"[{unit}]")
        about += f"; {about_type(hint)}" if about_type(hint) else ""
        if default is not inspect.Parameter.empty:
            default = _hashable(encode(default, unit))
        yield name, Annotated[held, Meta(description=about, extra={"unit": unit})], default


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def sentence(kind: Any) -> str:
    """Return the first sentence of the docstring of a class, without the full stop."""
    text = " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())
    return re.split(r"\. (?=[A-Z])", text)[0].removesuffix(".")


def attribute_descriptions(kind: Any) -> dict[str, str]:
    """Return the description of each attribute in the docstring of a class."""
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


def type_in_file(hint: Any, unit: str | None = "") -> Any:
    """Return the type of a key in files for an annotation; raise TypeError if there is none."""
    origin = get_origin(hint)
    inside = get_args(hint)
    if origin is Annotated:
        inner, *more = inside
        unit = unit if unit is None else unit_of_type(hint) or unit
        held = type_in_file(inner, unit)
        pairs = [(key, getattr(meta, key, None)) for meta in more for key in (*_BOUNDS, *_LENGTHS)]
        bounds = {key: item for key, item in pairs if item is not None}
        bounds |= {key: number_in(bounds[key], unit or "") for key in _BOUNDS if key in bounds}
        size = bounds.get("max_length", 0)
        if size and bounds.get("min_length") == size:
            return tuple[(get_args(held)[0],) * size]  # type: ignore[misc]
        return Annotated[held, Meta(**bounds)] if bounds and held != Number else held
    if hint is float:
        return Number if unit is None else float
    if hint == Array:
        return list[type_in_file(float, unit)]  # type: ignore[misc]
    if unit is not None and hint is Path:
        return list[float] | SAMPLES[unit]
    if unit is not None and is_union(hint) and Path in inside and type(None) not in inside:
        # One path for all tendons of a section, or a list with one path for each.
        of: Any = SAMPLES[unit]
        return list[float | list[float] | of] | of
    if is_union(hint):
        return choice(type_in_file(item, unit) for item in inside)
    if origin is tuple and inside[-1] is Ellipsis:
        return tuple[type_in_file(inside[0], unit), ...]  # type: ignore[misc]
    if origin is tuple or hasattr(hint, "_fields"):
        inside = inside or tuple(hints_of(hint).values())
        return tuple[tuple(type_in_file(item, unit) for item in inside)]  # type: ignore[misc]
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, type_in_file(inside[1], unit)]  # type: ignore[misc]
    if unit is None and is_of_project(hint):
        return choice(exact_choices(hint))
    if hint in TABLES:
        return TABLES[hint]
    if hint in (float, int, bool, str, type(None)) or origin is Literal or unit is None:
        return hint
    raise TypeError(f"{hint} has no type in files")


# The exact form


@cache
def exact(kind: Any, *, placed: bool = False, names: tuple[str, ...] = ()) -> Any:
    """Return the table of a class in the exact form, or of the arguments `names` only.

    Arguments with a default are optional. The key `kind` names the class, unless `placed`: then the
    place of the table implies the class. Unknown keys are errors.
    """
    if placed:
        PLACED.add(kind)
    fields: list[Any] = []
    for name, argument in inspect.signature(kind).parameters.items():
        if names and name not in names:
            continue
        held = type_in_file(hints_of(kind)[name], None)
        is_needed = argument.default is inspect.Parameter.empty
        fields.append((name, held) if is_needed else (name, held | UnsetType, UNSET))
    tag = None if placed else kind.__name__
    about = (kind.__doc__ or "").partition("\n")[0]
    strict = {"tag_field": None if placed else "kind", "forbid_unknown_fields": True}
    new_table = struct(f"Exact{kind.__name__}", fields, about, tag, msgspec.Struct, **strict)
    READ[new_table] = lambda table: read_exact(kind, table)
    return new_table


def exact_choices(kind: Any) -> list[Any]:
    """Return the exact tables of a class, or of all derived classes."""
    kinds = [kind] if kind in WRITE else [item for item in WRITE if issubclass(item, kind)]
    kinds = [Linear, *INTERPOLATIONS.values()] if kind is Path else kinds
    return list(map(exact, kinds)) or [exact(kind, placed=True)]
