"""Arms and measured shapes that the tests of calibration share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, Weight
from octoplan.planner import Measured

DATA = Path(__file__).parents[1] / "data" / "measured_tentacle.json"
HANGING = Scene(Extension(), ExactTendons(), Weight())
DOWN = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
MARKERS = ((0.1, (0.0, 0.0, 0.02)), (0.19, (0.0, 0.015, 0.0)))


def tentacle(E: float = 505e3, density: float = 1500.0) -> Arm:
    """Return the silicone tentacle of SoRoMoX, with its authors' initial values."""
    angles = tuple(np.radians([30.0, 150.0]).tolist())
    tendons = Anchorage(0.305, Linear(0.0114, 0.0024025), angles)
    material = Material(E, 0.45, density)
    return Arm(0.36, Linear(0.01541, 0.0048), (tendons,), material, DOWN)


def tentacle_shapes() -> list[Measured]:
    """Return its measured shapes; source and licence are in the file."""
    data: dict[str, Any] = json.loads(DATA.read_text())
    markers = data["markers"]
    return [
        Measured(
            own["tensions_N"],
            list(zip(markers["s_m"], markers["offset_local_tnb_m"], own["markers_m"], strict=True)),
            session=own["session"],
            name=own["file"],
        )
        for own in data["shapes"]
    ]


def small_arm() -> Arm:
    """A cylinder of 0.2 m with three tendons, hanging."""
    angles = tuple(np.radians([0.0, 120.0, 240.0]).tolist())
    anchorage = Anchorage(0.2, Linear(0.006, 0.005), angles)
    return Arm(0.2, Linear(0.01, 0.009), (anchorage,), Material(120e3, 0.45, 1100.0), DOWN)


PULLS = ([1.0, 0.0, 0.2], [0.0, 1.5, 0.0], [0.4, 0.0, 1.8], [2.0, 0.6, 0.0])


def synthetic(
    arm: Arm, scene: Scene, noise: float, seed: int, pulls: Any = PULLS
) -> list[Measured]:
    """Return the markers of an arm under tensions, with noise [m]."""
    rng, shapes = np.random.default_rng(seed), []
    for i, T in enumerate(pulls):
        shape = settle(arm, T, scene, accuracy=1e-7)
        points = []
        for s, offset in MARKERS:
            place = shape.position(s) + shape.frame(s) @ np.array(offset)
            points.append((s, offset, place + noise * rng.normal(size=3)))
        shapes.append(Measured(T, points, name=f"shape {i}"))
    return shapes
