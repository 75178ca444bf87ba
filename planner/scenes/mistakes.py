"""Mistakes in files, told in plain words: where, what is there, and what is allowed."""

from __future__ import annotations

import difflib
import re
from typing import Any

from model.errors import FileError, as_given, shortened
from planner.scenes.places import (
    choices_of,
    description_at,
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


def hint(given: Any, known: list[Any]) -> str:
    """Return "; did you mean ...?" where something known is close to what was given."""
    texts = [text for text in known if isinstance(text, str)]
    if not isinstance(given, str):
        return ""
    starts = [text for text in texts if text.startswith(f"{given}_")]
    near = starts or difflib.get_close_matches(given.lower().replace("-", "_"), texts, 1, 0.6)
    near = near or difflib.get_close_matches(given, texts, 1, 0.6)
    return f'; did you mean "{near[0]}"?' if near else ""


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
