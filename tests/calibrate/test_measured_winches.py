"""A measured robot with winches; source and licence are in the file of the data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene
from octoplan.model.effects import ExactTendons, Extension
from octoplan.planner import Measured, Unknown, calibrate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.residuals import mean_distance

DATA = Path(__file__).parents[1] / "data" / "ftdcr_displacements.json"
# Ends of the segments from the tip [m], and angle of the first tendon of each [rad].
ENDS = {0.1865: -2.05, 0.1225: -2.56, 0.06: -3.06}
# Displacements [m] of tendons that are paid out far, and below which all tendons are slack.
PAID_OUT = -5e-3
SLACK = -3e-4
RAW = json.loads(DATA.read_text())


def robot() -> Arm:
    """Return the robot on its steel wire, with the axes of the markers as n, b and t."""
    thirds = 2 * np.pi / 3 * np.arange(3)
    offset = Linear(4.5e-3, 4.5e-3)
    sections = tuple(Anchorage(at, offset, tuple(phi + thirds)) for at, phi in ENDS.items())
    wire = Linear(5e-4, 5e-4)
    frame = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    base = (0.0, 0.012, 0.0)
    steel = Material(50e9, 0.3, 7800.0)
    return Arm(0.1865, wire, sections, steel, frame, base, hull=Linear(0.01, 0.01))


def shapes(kind: str) -> list[Measured]:
    """Return the tips for the displacements of the tendons; tendons paid out far are slack."""
    result = []
    for i, row in enumerate(RAW[kind]):
        pulls = 1e-3 * np.array(row["pull_mm"]).reshape(3, 3)[::-1].ravel()
        if pulls.max() > SLACK:
            strokes = np.where(pulls < PAID_OUT, np.nan, pulls)
            tip = tuple(1e-3 * np.array(row["tip_mm"]))
            result.append(Measured(strokes=strokes, tip=tip, name=f"{kind} {i}"))  # type: ignore[arg-type]
    return result


def fitted(seen: list[Measured], more: list[Unknown]) -> Calibration:
    """Return the fit of stretch, angles of the tendons, pose of the base, and more unknowns."""
    arm = robot()
    angles = [
        Unknown(f"arm.sections[{i}].angles_deg[{j}]", np.degrees(phi) - 40, np.degrees(phi) + 40)
        for i, section in enumerate(arm.sections)
        for j, phi in enumerate(section.angles)
    ]
    base = [Unknown(f"arm.base_position_mm[{k}]", -30, 30) for k in range(3)]
    base += [Unknown(f"arm.base_rotation_deg[{k}]", -15, 15) for k in (1, 2)]
    unknowns = [Unknown("winches.tendon_EA_N", 50, 50000), *angles, *base, *more]
    options: dict[str, Any] = {"tendon_EA": 1000.0, "starts": 1, "loss": "soft_l1"}
    scene = Scene(Extension(), ExactTendons())
    return calibrate(arm, scene, seen, unknowns, accuracy=1e-3, **options)


@pytest.mark.slow
def test_zeros_of_winches_explain_a_measured_robot() -> None:
    """Zeros halve the errors in sample, and reduce the ones of other single-tendon shapes."""
    rows = shapes("single_tendon")
    seen = rows[::5]
    others = [row for i, row in enumerate(rows) if i % 5 == 2]
    plain = fitted(seen, [])
    zeros = fitted(seen, [Unknown(f"winches.zero_mm[{j}]", -3, 3) for j in range(9)])
    assert zeros.mean_error < 0.6 * plain.mean_error
    held_out = [mean_distance(found.errors(others)) for found in (plain, zeros)]
    assert held_out[1] < 0.8 * held_out[0]
