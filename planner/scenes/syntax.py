"""Text that is not valid TOML, told with its line and what is most often meant."""

from __future__ import annotations

import re

from model.errors import FileError, shortened

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
