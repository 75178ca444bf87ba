"""The measured robot of `tests/data/ftdcr_displacements.json` as an arm that lengths hold.

Measured by the Continuum Robotics Lab (opencr-mujoco, MIT): a steel wire of 186.5 mm with three
segments of three tendons that discs hold at 4.5 mm; what winches take in, and where the tip goes.

What a single pulled tendon cannot tell is left out of the fit: its offset trades with how much it
stretches, and stays what the discs are made to; rotation about the arm trades with all angles.
What the arm is compressed by, the base and its mount with it, counts as axial stiffness of the
wire: nine tendons that are tight shorten the arm and slacken each other, a single one does not.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from model import Anchorage, Arm, Linear, Material, OctoplanError, Scene, Shape, settle
from model.effects import ExactTendons, Extension
from model.paths import Array
from model.winches import rest_lengths

DATA = Path(__file__).parents[1] / "tests" / "data" / "ftdcr_displacements.json"
SCENE = Scene(Extension(), ExactTendons())
ENDS = (0.06, 0.1225, 0.1865)
FLOOR = 1.8e-3
# What is fitted, the first guess of each, and what counts as a unit of it.
NAMES = (
    "log10 of the tendons' E A [N]",
    "log10 of the arm's E A [N]",
    *(f"angle of segment {i} [rad]" for i in (1, 2, 3)),
    *(f"lost motion of segment {i} [m]" for i in (1, 2, 3)),
    *(f"rotation {axis} [rad]" for axis in "xy"),
    *(f"translation {axis} [m]" for axis in "xyz"),
)
FIRST = np.array([3.0, 3.0, -3.06, -2.56, -2.05, 0.0, 0.0, 0.0, 0, 0, 0, 0.012, 0])
UNITS = np.array([0.3, 0.3, 0.1, 0.1, 0.1, 3e-4, 3e-4, 3e-4, 0.05, 0.05, 3e-3, 3e-3, 3e-3])
# Of the discs, and flexural stiffness of the wire: steel of 0.5 mm radius, E of 50 GPa as there.
OFFSET, FLEXURAL = 4.5e-3, 50e9 * np.pi * 0.5e-3**4 / 4
# Rows whose tendon is paid out farther are slack, and tell where the tip wanders to.
_SLACK = -3e-4


@dataclass(frozen=True, eq=False)
class Row:
    """A measured pose: what is taken in of each tendon, base segment first, and the tip [m]."""

    label: str
    pull: Array
    tip: Array


@lru_cache(maxsize=1)
def measured() -> tuple[list[Row], list[Row]]:
    """Return the rows with one tendon pulled, and the mixed ones."""
    data = json.loads(DATA.read_text())
    return rows_of(data["single_tendon"]), rows_of(data["mixed"])


def rows_of(rows: list[dict[str, Any]]) -> list[Row]:
    """Return rows of the file in SI units."""
    return [
        Row(r["label"], 1e-3 * np.array(r["pull_mm"]), 1e-3 * np.array(r["tip_mm"])) for r in rows
    ]


def robot(x: Array) -> Arm:
    """Return the arm of fitted values, its sections tip to base; its tip in its own frame.

    Radius and modulus are those of a bar that has the wire's E J and the fitted E A.
    """
    thirds = 2 * np.pi / 3 * np.arange(3)
    sections = tuple(
        Anchorage(at, Linear(OFFSET, OFFSET), tuple(x[2 + i] + thirds))
        for i, at in reversed([*enumerate(ENDS)])
    )
    frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    axial = 10.0 ** x[1]
    R = 2 * np.sqrt(FLEXURAL / axial)
    bar = Material(axial / (np.pi * R**2), 0.3, 7800.0)
    return Arm(ENDS[-1], Linear(R, R), sections, bar, frame, hull=Linear(1e-2, 1e-2))


def settled(arm: Arm, x: Array, pull: Array) -> Shape:
    """Return the shape for what is taken in of each tendon (9,), base segment first [m]."""
    taken = pull - np.repeat(x[5:8], 3)
    lengths = rest_lengths(arm) - taken.reshape(3, 3)[::-1].ravel()
    return settle(arm, scene=SCENE, accuracy=1e-3, lengths=lengths, tendon_EA=10.0 ** x[0])


def tips(x: Array, rows: list[Row]) -> Array:
    """Return where the tips of rows are (N, 3) [m], in the frame of the markers."""
    pulls = tuple(tuple(row.pull.tolist()) for row in rows)
    turn = Rotation.from_rotvec([*x[8:10], 0.0])
    return turn.apply(_tips(tuple(x[:8].tolist()), pulls)) + x[10:13]


@lru_cache(maxsize=64)
def _tips(own: tuple[float, ...], pulls: tuple[tuple[float, ...], ...]) -> Array:
    """Return tips (N, 3) in the arm's own frame: its n, b and t are the markers' x, y and z."""
    x, found = np.array(own), []
    arm = robot(x)
    for pull in pulls:
        try:
            found.append(settled(arm, x, np.array(pull)).tip)
        except OctoplanError:
            found.append(np.zeros(3))
    return np.array(found)[:, [1, 2, 0]]


def fitted(rows: list[Row], first: Array = FIRST, steps: int = 12) -> Array:
    """Return the values that bring tips nearest to those measured, far ones counted less.

    Of the rows in which a tendon is pulled.
    """
    rows = [row for row in rows if row.pull.max() > _SLACK]
    goal = np.array([row.tip for row in rows])

    def off(z: Array) -> Array:
        return np.ravel(tips(z * UNITS + FIRST, rows) - goal) / 5e-3

    start = (first - FIRST) / UNITS
    found = least_squares(off, start, loss="soft_l1", diff_step=1e-3, max_nfev=steps)
    return np.asarray(found.x * UNITS + FIRST)
