"""Scene, sweep and plan files with mistakes: mutations of valid files, from a seed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension
from octoplan.planner import plan
from octoplan.planner.frontends.io.files import to_json
from octoplan.planner.frontends.io.saved_records import plan_record
from octoplan.planner.targets import TipPosition

SCENES = sorted((Path(__file__).parents[2] / "studies" / "scenes").glob("*.toml"))
NUMBERS = (
    "0", "-0.0", "1", "-1", "0.5", "3", "1e308", "-1e308", "1e309", "5e-324", "1e-300", "1e-9",
    "nan", "-nan", "inf", "-inf", "1e6", "9223372036854775808", "1_000", "0x10", "true",
)  # fmt: skip
VALUES = (
    *NUMBERS, '"text"', '""', '"1.0"', "[]", "{}", "[[]]", "[1.0]", "[1.0, 2.0, 3.0]",
    "[[1.0, 2.0], [3.0]]", "[nan, nan, nan]", "1979-05-27", "[" * 200 + "]" * 200,
    "[" + "1.0," * 3000 + "]", '"\\u0000"', '"table-4"', '"tip"', '"length"',
)  # fmt: skip
# A bare number, not a part of a name or of another number.
_NUMBER = re.compile(r"(?<![\w.+-])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])")
_PAIR = re.compile(r"^(\s*[\w.-]+\s*=\s*)(.+?)(\s*(?:#.*)?)$", re.MULTILINE)
Mutation = Callable[[np.random.Generator, str], str]


def _one(rng: np.random.Generator, found: list[re.Match[str]], text: str, new: str) -> str:
    if not found:
        return text
    match = found[rng.integers(len(found))]
    return text[: match.start()] + new + text[match.end() :]


def number(rng: np.random.Generator, text: str) -> str:
    """Put another number in a number's place."""
    return _one(rng, list(_NUMBER.finditer(text)), text, str(rng.choice(NUMBERS)))


def nearby(rng: np.random.Generator, text: str) -> str:
    """Change a number by a factor up to ten, or its sign."""
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    match = found[rng.integers(len(found))]
    factor = float(rng.choice([-1.0, 1.0], p=[0.1, 0.9]) * 10 ** rng.normal())
    return text[: match.start()] + f"{float(match[0]) * factor:.6g}" + text[match.end() :]


def value(rng: np.random.Generator, text: str) -> str:
    """Put any value in a key's place."""
    found = list(_PAIR.finditer(text))
    if not found:
        return text
    match = found[rng.integers(len(found))]
    new = match[1] + str(rng.choice(VALUES)) + match[3]
    return text[: match.start()] + new + text[match.end() :]


def without(rng: np.random.Generator, text: str) -> str:
    """Leave a line out."""
    lines = text.split("\n")
    del lines[rng.integers(len(lines))]
    return "\n".join(lines)


def twice(rng: np.random.Generator, text: str) -> str:
    """Repeat a line at a random place."""
    lines = text.split("\n")
    lines.insert(int(rng.integers(len(lines) + 1)), lines[rng.integers(len(lines))])
    return "\n".join(lines)


def misspelt(rng: np.random.Generator, text: str) -> str:
    """Change or delete one letter."""
    i = int(rng.integers(max(len(text), 1)))
    return (
        text[:i] + str(rng.choice(["", "x", "_", "=", "[", '"', "\n", "é", "\x00"])) + text[i + 1 :]
    )


def crossed(rng: np.random.Generator, text: str) -> str:
    """Go on with another scene from some line on."""
    lines = text.split("\n")
    others = SCENES[rng.integers(len(SCENES))].read_text(encoding="utf-8").split("\n")
    cut, begin = rng.integers(len(lines)), rng.integers(len(others))
    return "\n".join(lines[:cut] + others[begin:])


MUTATIONS: tuple[Mutation, ...] = (number, nearby, nearby, value, without, twice, misspelt, crossed)


def mutated(seed: int) -> bytes:
    """Return the text of a scene file with one to four mutations, in some encoding."""
    rng = np.random.default_rng(seed)
    text = SCENES[rng.integers(len(SCENES))].read_text(encoding="utf-8")
    for _ in range(rng.integers(1, 5)):
        text = MUTATIONS[rng.integers(len(MUTATIONS))](rng, text)
    way = rng.uniform()
    if way < 0.01:
        return rng.integers(256, size=rng.integers(200)).astype(np.uint8).tobytes()
    encoding = "utf-8" if way < 0.97 else str(rng.choice(["utf-16", "utf-8-sig", "latin-1"]))
    return text.encode(encoding, errors="replace")


AXES = (
    'key = "arm.E_kPa"\nvalues = [90.0, 110.0]',
    'key = "tensions[0][1]"\nstart = 0.0\nstop = 2.0\ncount = 3',
    'key = "accuracy"\nvalues = [1e-3]\nname = "digits"',
    'key = "arm.nu"\ndistribution = "uniform"\nlow = 0.3\nhigh = 0.5',
    'key = "target.position_mm[0]"\ndistribution = "normal"\nmean = 200.0\nsd = 10.0',
)
OTHERS = (
    None, True, 0, -1, 1e308, 5e-324, 10**30, "", "nan", "inf", "text", [], {}, [[]], [None],
    {"kind": []}, "x" * 3000, [1.0] * 300,
)  # fmt: skip


def sweep_file(seed: int) -> bytes:
    """Return the text of a sweep file with its scene as a table, mutated once to three times."""
    rng = np.random.default_rng(seed)
    scene = SCENES[rng.integers(len(SCENES))].read_text(encoding="utf-8")
    own = [line for line in scene.splitlines() if not line.lstrip().startswith("#")]
    tables = [f"[scene.{line.lstrip()[1:]}" if line.startswith("[") else line for line in own]
    compute = rng.choice(["settle", "settle", "plan", "stiffness"])
    draws = "\ndraws = 2" if rng.uniform() < 0.4 else ""
    axes = "\n".join(f"[[sweep.axes]]\n{axis}" for axis in rng.choice(AXES, rng.integers(1, 3)))
    tables = [line.replace("[scene.[", "[[scene.") for line in tables]
    text = "\n".join(["[scene]", *tables, f'[sweep]\ncompute = "{compute}"{draws}', axes])
    for _ in range(rng.integers(0, 4)):
        text = MUTATIONS[rng.integers(len(MUTATIONS))](rng, text)
    return text.encode(errors="replace")


@cache
def _plan_text() -> str:
    arm, scene = Arm.from_paper("table-4"), Scene(Extension())
    found = plan(arm, TipPosition((0.2, 0.1, 0.1)), scene, 20.0)
    return to_json(plan_record(found)).decode()


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return the containers and keys of all values inside a value."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    found = []
    for key, own in pairs:
        found.append((value, key))
        if isinstance(own, dict | list):
            found += _places(own)
    return found


def plan_file(seed: int) -> bytes:
    """Return the text of a plan file with some values changed or deleted, or a spoilt text."""
    rng = np.random.default_rng(seed)
    table = json.loads(_plan_text())
    for _ in range(rng.integers(1, 4)):
        places = _places({"question": table["question"], "answer": table["answer"]})
        where, key = places[rng.integers(2, len(places))]
        way = rng.uniform()
        if way < 0.6:
            where[key] = deepcopy(OTHERS[rng.integers(len(OTHERS))])
        elif way < 0.8 and isinstance(where[key], int | float):
            where[key] = float(where[key]) * float(rng.choice([-1.0, 1.0, 10.0, 1e-3]))
        elif isinstance(where, dict):
            del where[key]
        else:
            where.insert(key, deepcopy(where[key]))
    text = json.dumps(table)
    if rng.uniform() < 0.1:
        i = int(rng.integers(len(text)))
        text = text[:i] + str(rng.choice(["", "x", "{", '"', "\x00", "9" * 5000])) + text[i + 1 :]
    return text.encode()


WRITTEN = {"scene": mutated, "sweep": sweep_file, "plan": plan_file}
