"""Calibration files: TOML, with the measured shapes in a CSV file beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from model import Arm, Scene
from model.errors import FileError
from planner.fit.calibrate import calibrate
from planner.fit.calibration import Calibration
from planner.fit.measured import Measured
from planner.fit.shapes_csv import load_shapes
from planner.fit.unknowns import Unknown, unknown_of
from planner.io.codec import si
from planner.io.scene_file import converted, decoded, scene_beside, text_of
from planner.io.scene_tables import CalibrationFile

_SUCH = """

scene = "scene.toml"
measured = "shapes.csv"
[[unknowns]]
key = "arm.E_kPa"
lower = 50.0
upper = 500.0"""


@dataclass(frozen=True)
class Asked:
    """What a calibration file asks: the arguments of calibrate."""

    arm: Arm
    scene: Scene
    measured: tuple[Measured, ...]
    unknowns: tuple[Unknown, ...]
    options: dict[str, Any]

    def run(self) -> Calibration:
        """Calibrate."""
        return calibrate(self.arm, self.scene, self.measured, self.unknowns, **self.options)


def load_asked(path: str | Path) -> Asked:
    """Return what a calibration file asks; FileError with the file, the key and what is allowed."""
    path = Path(path)
    name = str(path)
    raw = decoded(text_of(path), name)
    needed = f"a calibration file is such as {_SUCH}"
    file = converted(raw, CalibrationFile, "unknowns", name, needed)
    asked = scene_beside(file.scene, path)
    names = [point.name for point in file.points]
    if len(set(names)) < len(names):
        raise FileError(name, "points", f"got {', '.join(names)}; allowed is each name once")
    shapes = load_shapes(path.parent / file.measured, asked.arm, file.points, si(file.std_mm, "mm"))
    unknowns = tuple(unknown_of(own, name, f"unknowns[{i}]") for i, own in enumerate(file.unknowns))
    options = {
        "loss": file.loss,
        "absolute_std": file.absolute_std,
        "starts": file.starts,
        "accuracy": file.accuracy,
    }
    return Asked(asked.arm, asked.scene, shapes, unknowns, options)
