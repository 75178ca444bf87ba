"""Sweep and plan files with a mistake or more in them, from a seed."""

from __future__ import annotations

import json
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np

from model import Arm, Scene
from model.effects import Extension
from planner import plan
from planner.io.files import to_json
from planner.io.saved_records import plan_record
from planner.targets import TipPosition
from tests.fuzz.mutations import MUTATIONS, SCENES, mutated

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
    """Return the text of a plan file with some values in it changed, left out, or text spoilt."""
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
