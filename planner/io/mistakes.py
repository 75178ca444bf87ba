"""Mistakes in files, told in plain words: where, what is there, and what is allowed.

What msgspec refuses (`mistake`), what a TOML parser does not understand (`no_toml`), and what a
class refuses in SI units, told by the file's own key, number and unit (`as_written`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from model.errors import FileError, InputError, as_given, shortened
from planner.io.key_paths import (
    choices_of,
    description_at,
    hint,
    keys_of,
    kinds_at,
    places,
    steps,
    tags_of,
    value_at,
)

_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list [...]",
    "object": "a table",
}
_LONG = 60


def mistake(reason: str, name: str, table: Any, root: Any) -> FileError:
    """Return what msgspec found wrong with a table, as an error that names file and key.

    Parameters
    ----------
    reason : str
        The words of msgspec.ValidationError.
    name : str
        Of the file.
    table : Any
        What the file holds.
    root : type
        What it should hold.
    """
    what, _, where = reason.partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    kinds, given = kinds_at(root, table, steps(path)), value_at(table, steps(path))
    unknown = re.match(r"Object contains unknown field `(.*)`", what)
    if unknown:
        return _unknown(name, path, shortened(unknown[1]), kinds, root)
    missing = re.match(r"Object missing required field `(.*)`", what)
    if missing:
        return FileError(name, _join(path, missing[1]), _lacking(missing[1], path, kinds))
    if what.startswith("Invalid"):
        known = choices_of(kinds) or tags_of(kinds_at(root, table, steps(path)[:-1]))
        allowed = f"one of {', '.join(dict.fromkeys(map(str, known)))}"
        return FileError(
            name, path, f"got {shown(given)}, allowed is {allowed}{hint(given, known)}"
        )
    allowed = _plain(what)
    if allowed == "a table":
        allowed = f"a table {{ ... }} of the keys {', '.join(keys_of(kinds))}"
    if _WORDS["array"] in allowed:
        told = description_at(root, table, steps(path))
        allowed = f"{allowed}: {told}" if told else allowed
    return FileError(name, path or "the file", f"got {shown(given)}, allowed is {allowed}")


def shown(value: Any) -> str:
    """Return a value as a file would write it, shortened."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else as_given(value)
    return text if len(text) <= _LONG else f"{text[: _LONG - 4]} ..."


def _unknown(name: str, path: str, key: str, kinds: list[Any], root: Any) -> FileError:
    known = keys_of(kinds)
    elsewhere = places(root, key)
    if "" in elsewhere:
        more = "; it belongs at the top of the file, above the first [table]"
    elif len(elsewhere) == 1:
        more = f"; it belongs in [{elsewhere[0]}]"
    else:
        more = hint(key, known)
    return FileError(name, _join(path, key), f"no such key{more} (known here: {', '.join(known)})")


def _lacking(key: str, path: str, kinds: list[Any]) -> str:
    if key == "type":
        return f"missing, allowed is one of {', '.join(tags_of(kinds))}"
    return f"missing; {f'[{path}]' if path else 'the file'} needs it"


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _plain(what: str) -> str:
    """Return "Expected `float` > 0.0, got ..." in plain words: a number above 0."""
    wanted = what.removeprefix("Expected ").split(", got ")[0]
    kinds, bound = re.match(r"`([^`]*)`(.*)", wanted).groups() if "`" in wanted else (wanted, "")  # type: ignore[union-attr]
    words = [_WORDS.get(kind, kind) for kind in kinds.split(" | ") if kind != "null"]
    if kinds == "array" and bound:
        size = bound.removeprefix(" of length ").replace(">= ", "at least ")
        return f"a list of {size}"
    bound = re.sub(r"(\d)\.0\b", r"\1", bound)
    for sign, word in ((">=", "of at least"), ("<=", "up to"), (">", "above"), ("<", "below")):
        bound = bound.replace(f" {sign} ", f" {word} ")
    return " or ".join(words) + bound


_REMEDIES = (
    (r"=\s*-?\d+,\d", "decimal numbers have a point: 0.5"),
    (
        r"=\s*[A-Za-z_][\w-]*\s*(#.*)?$",
        'text goes in quotes, as in preset = "table-4"; true, false',
    ),
    (r"=\s*-?[\d.]+\s*[A-Za-z]", "a number stands alone; its unit is in the key"),
    (r"=\s*-?\.\d|=\s*-?\d+\.(\D|$)", "digits on both sides of a point: 0.5, 3.0"),
    (r"^\s*[\w.]+\s*:", "keys and values are joined by =, as in nu = 0.5"),
    (r"^\s*\[[^\]]*$", "a table begins with its name in brackets, as in [arm]"),
)


def no_toml(reason: str, text: bytes, name: str) -> FileError:
    """Return what a parser said of a text as an error that names the file and shows the line.

    Parameters
    ----------
    reason : str
        The parser's words, with "(at line 3, column 5)" at their end where it knows the place.
    text : bytes
        What the file holds.
    name : str
        Of the file.
    """
    place = re.search(r" \(at line (\d+), column \d+\)$", reason)
    if place is None:
        return FileError(name, "", f"this is not valid TOML: {reason}")
    number = int(place[1])
    lines = text.decode(errors="replace").splitlines()
    line = lines[number - 1].strip() if number <= len(lines) else ""
    words = re.sub(
        r"Cannot declare \('(.*)',\) twice", r"[\1] is there twice", reason[: place.start()]
    )
    remedy = next((f"; {told}" for wrong, told in _REMEDIES if re.search(wrong, line)), "")
    return FileError(
        name,
        f"line {number}",
        f"not valid TOML: {words[0].lower()}{words[1:]}: {shortened(line)}{remedy}",
    )


# By the end of a key: its unit in words, and how much of SI's that is.
_UNITS = {"_mm": ("mm", 1e-3), "_deg": ("degrees", math.pi / 180), "_kPa": ("kPa", 1e3)}
_NUMBER = r"-?\d+(?:\.\d*)?(?:e[+-]?\d+)?"
_SI = {"mm": "m", "degrees": "rad", "kPa": "Pa"}


def as_written(reason: InputError, name: str, key: str, part: Any) -> FileError:
    """Return what is not allowed as an error of the file that said so.

    Parameters
    ----------
    reason : InputError
        Of a value in SI units.
    name, key : str
        The file, and the path of the part of it that was built.
    part : Any
        What the file holds there.
    """
    asked = re.split(r"[. ]", re.sub(r"\[\d+\]", "", reason.field))[-1]
    found = [(path, own) for path, own in _measured(key, part) if _is(own, path, reason.given)]
    named = [
        item for item in found if re.search(rf"\b{re.escape(asked)}(_|\b)", item[0][len(key) :])
    ]
    if not named and len(found) != 1:
        return FileError.of(reason, name, key)
    path, own = (named or found)[0]
    allowed = _in(_unit(path)[0], reason.allowed)
    return FileError(name, path, f"got {shown(own)}, allowed is {allowed}")


def _measured(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield paths and values, lists and numbers, of keys that name a unit."""
    if isinstance(value, dict):
        for key, own in value.items():
            yield from _measured(f"{path}.{key}" if path else key, own)
    elif isinstance(value, list):
        if _unit(path)[0]:
            yield path, value
        for i, own in enumerate(value):
            yield from _measured(f"{path}[{i}]", own)
    elif isinstance(value, int | float) and _unit(path)[0]:
        yield path, value


def _unit(path: str) -> tuple[str, float]:
    last = re.sub(r"(\[\d+\])+$", "", path)
    return next((unit for end, unit in _UNITS.items() if last.endswith(end)), ("", 1.0))


def _is(own: Any, path: str, given: Any) -> bool:
    """Whether a value of the file is the one that was given, or a list of which it is the ends."""
    try:
        wanted = np.asarray(given, dtype=float)
        with np.errstate(over="ignore"):
            found = _unit(path)[1] * np.asarray(own, dtype=float)
    except (TypeError, ValueError):
        return False
    if found.size and found.ndim and wanted.shape == (2,) != found.shape:
        found = found[[0, -1]]
    return found.shape == wanted.shape and np.allclose(found, wanted, 1e-9, 0, equal_nan=True)


def _in(unit: str, allowed: str) -> str:
    """Return what is allowed with SI numbers in the unit of a key."""
    si, size = _SI[unit], next(size for own, size in _UNITS.values() if own == unit)

    def other(found: re.Match[str]) -> str:
        return f"{float(found[1]) / size:.6g} {unit}"

    def others(found: re.Match[str]) -> str:
        return f"[{', '.join(f'{float(own) / size:.6g}' for own in found[1].split(','))}] {unit}"

    text = re.sub(rf"({_NUMBER}) {si}\b", other, allowed)
    text = re.sub(rf"\[({_NUMBER}(?:, *{_NUMBER})*)\](?! {unit})", others, text)
    if unit == "degrees":
        text = re.sub(r"\bpi( rad)?\b", r"180\1", text)
    return re.sub(r"\brad\b", unit, text) if unit == "degrees" else text
