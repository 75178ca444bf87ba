"""Arms of the finite-element references, and scenes by the references' names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Scene
from octoplan.model.effects import ExactTendons, Extension, NeoHookean
from tests.oracles import Array

DATA = Path(__file__).parents[2] / "data"
EXACT = Scene(Extension(), ExactTendons())
SILICONE = Scene.silicone()
SWOLLEN = Scene(Extension(), ExactTendons(), NeoHookean(anticlastic=True))
RODS = {"paper": Scene(Extension()), "exact": EXACT, "nh": SILICONE, "nha": SWOLLEN}


def fem_cases() -> list[dict[str, Any]]:
    """The finite-element cases without load at the tip."""
    cases = json.loads((DATA / "fem_reference.json").read_text())["cases"]
    return [case for case in cases if not case["label"].endswith("F1e-3")]


def fem_arm(case: dict[str, Any]) -> tuple[Arm, Array]:
    """Return the arm of a case in the paper's base frame (n = -y, b = -z), and its tensions [N]."""
    p = case["params"]
    if "tendons" in p:
        first = p["tendons"][0]
        offset = Linear(first["a"], first["b"])
        angles = [float(np.arctan2(-t["dir"][2], -t["dir"][1])) for t in p["tendons"]]
        tension = float(case["label"])
    else:
        kind, pull, _ = case["label"].split()
        offset = Linear(0.0, 0.0) if kind == "centre" else Linear(7.5e-3, 1e-3)
        turn = np.pi / 2 if kind == "outplane" else 0.0
        angles, tension = [turn, turn + np.pi], float(pull[1:])
    anchorage = Anchorage(p["L"], offset, tuple(angles))
    return Arm(p["L"], Linear(p["Rmax"], p["Rmin"]), (anchorage,)), np.full(len(angles), tension)


def name_of(case: dict[str, Any]) -> str:
    """The name of a case."""
    return f"{case['case']} {case['label']}"
