"""C of long functions without branches, cut into pieces that a compiler is soon done with.

The time of a compiler grows faster than the length of a function. CasADi writes an SX function as
one list of assignments to variables; here the list is cut, and what later pieces read of earlier
ones is handed on in an array. Operations and their order stay, and so do the digits.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

# Longer pieces take the compiler longer, shorter ones hand on more: the code of 64 to 250 lines
# takes as long to run, within a tenth.
_LINES = 128
_BEGIN = re.compile(r"^static int \w+\(const casadi_real\*\* arg, .*\{$", re.MULTILINE)
_END = "\n  return 0;\n}"
_DECLARED = "  casadi_real a"
_VARIABLE = re.compile(r"\ba\d+\b")
_ASSIGNED = re.compile(r"  (a\d+)=")


def in_pieces(source: str) -> str:
    """Return CasADi's C of one SX function, with its list of assignments in pieces."""
    begin = _BEGIN.search(source)
    assert begin is not None
    head, name = source[: begin.start()], begin.group()
    body, tail = source[begin.end() :].split(_END, 1)
    lines = [line for line in body.strip("\n").split("\n") if not line.startswith(_DECLARED)]
    if len(lines) <= 2 * _LINES:
        return source
    arguments = {"arg": "const casadi_real**", "res": "casadi_real**"}
    functions, calls = cut(lines, "piece", arguments, "casadi_real")
    return "".join([head, functions, name, "\n", calls, _END, tail])


def cut(
    lines: Sequence[str], name: str, arguments: Mapping[str, str], number: str
) -> tuple[str, str]:
    """Return functions that do the assignments of lines in pieces, and what calls all of them.

    They are named after `name`; `arguments` are those of the whole, with their types, and `number`
    is the type of the variables.
    """
    pieces = [lines[i : i + _LINES] for i in range(0, len(lines), _LINES)]
    written, later = [], set[str]()
    given = ", ".join(f"{kind} {own}" for own, kind in arguments.items())
    for k, piece in reversed(list(enumerate(pieces))):
        head = f"static void {name}{k}({given}, {number}* kept)"
        written.append(_piece(head, piece, later, number))
        later = (later - _assigned(piece)) | _read(piece)
    size = 1 + max(int(v[1:]) for line in lines for v in _VARIABLE.findall(line))
    handed = ", ".join([*arguments, "kept"])
    calls = [f"\n  {name}{k}({handed});" for k in range(len(pieces))]
    return "".join(reversed(written)), "".join([f"  {number} kept[{size}];", *calls])


def _piece(head: str, lines: Sequence[str], later: set[str], number: str) -> str:
    """Return a piece as a function that reads and leaves in `kept` what others share with it."""
    read, assigned = _read(lines), _assigned(lines)
    return "\n".join(
        [
            f"__attribute__((noinline)) {head} {{",
            f"  {number} {', '.join(sorted(read | assigned))};",
            *(f"  {v}=kept[{int(v[1:])}];" for v in sorted(read)),
            *lines,
            *(f"  kept[{int(v[1:])}]={v};" for v in sorted(assigned & later)),
            "}\n\n",
        ]
    )


def _assigned(lines: Sequence[str]) -> set[str]:
    return {match.group(1) for match in map(_ASSIGNED.match, lines) if match}


def _read(lines: Sequence[str]) -> set[str]:
    """Return the variables that are read before they are assigned."""
    read, assigned = set[str](), set[str]()
    for line in lines:
        match = _ASSIGNED.match(line)
        read.update(set(_VARIABLE.findall(line[match.end() :] if match else line)) - assigned)
        if match:
            assigned.add(match.group(1))
    return read
