"""What files hold, as TOML and JSON decode it; a sentence for what is no such file."""

from __future__ import annotations

import difflib
import errno
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from model.errors import FileError, as_given, shortened
from planner.io.files import why

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


def bytes_of(path: Path, wanted: Callable[[], str]) -> bytes:
    """Return what a file holds; FileError, with what is wanted, where it cannot be read.

    A pipe is none: it might never end.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise OSError(errno.EINVAL, "this is no ordinary file")
        return path.read_bytes()
    except (OSError, ValueError) as reason:  # ValueError for names that no file can have
        raise FileError(str(path), "", f"{why(reason)}; {wanted()}") from None


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return what a TOML file holds, and its text; FileError."""
    text = bytes_of(path, lambda: _instead(path))
    if path.suffix.lower() != ".toml":
        wanted = "no scene file: those are TOML, with names that end in .toml"
        raise FileError(str(path), "", wanted)
    return toml_of(text, str(path)), text.decode(errors="replace")


def _instead(path: Path) -> str:
    """Return what to name in place of a file that cannot be read."""
    others: dict[str, str] = {}
    with suppress(OSError, ValueError):
        result = (other for other in path.parent.glob("*.toml") if other.is_file())
        others = {other.stem: other.name for other in result}
    near = difflib.get_close_matches(path.stem, others, 1)
    if near:
        return f'did you mean "{path.with_name(others[near[0]])}"?'
    return "a scene file is wanted, `octoplan new FILE` writes one"


def toml_of(text: bytes, name: str) -> dict[str, Any]:
    """Return what a TOML text holds; FileError that shows the line where it is none."""
    try:
        return dict(msgspec.toml.decode(text))
    except (msgspec.DecodeError, ValueError, RecursionError) as reason:
        words, _, place = str(reason).rpartition(" (at line ")
        number = place.partition(",")[0]
        if not number.isdigit():
            raise FileError(name, "", f"this is not valid TOML: {reason}") from None
    lines = text.decode(errors="replace").splitlines()[int(number) - 1 : int(number)]
    line = lines[0].strip() if lines else ""
    remedy = next((f"; {message}" for wrong, message in _REMEDIES if re.search(wrong, line)), "")
    message = f"not valid TOML: {words[:1].lower()}{words[1:]}: {shortened(line)}{remedy}"
    raise FileError(name, f"line {number}", message)


def read_json(path: Path, what: str, version: int) -> dict[str, Any]:
    """Return what a saved file of a kind and version holds; FileError for others, with what to do.

    Its `schema` is "octoplan WHAT VERSION".
    """
    name, wanted = str(path), f"octoplan {what} {version}"
    try:
        table = msgspec.json.decode(bytes_of(path, lambda: f"a {what} that was saved is wanted"))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as reason:
        raise FileError(name, "", f"this is not valid JSON: {reason}") from None
    if not isinstance(table, dict):
        allowed = f"a {what} that was saved"
        raise FileError(name, "the file", f"got {as_given(table)}, allowed is {allowed}")
    result = table.get("schema")
    if result == wanted:
        return table
    message = f"got {as_given(result)}, allowed is one of {wanted}"
    if result is None:
        message = f'missing; a saved {what} has schema = "{wanted}"'
    elif isinstance(result, str) and result.startswith(f"octoplan {what} "):
        message += "; another version of octoplan wrote it: load it there, or find it again here"
    raise FileError(name, "schema", message)
