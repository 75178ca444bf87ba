"""Arms, scenes and tensions for settles by lengths."""

from __future__ import annotations

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Material, OctoplanError, Scene, Shape, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.friction import Friction
from octoplan.model.paths import Array
from tests.core.model.cases import arm_of, random_rod

EXACT = Scene(Extension(), ExactTendons())
_SILICONE = (Extension(), ExactTendons(), NeoHookean())
# Scenes in which only a tendon's tension shortens the tendon: lengths determine the shape.
SCENES = {
    "inextensible": Scene(ExactTendons()),
    "exact": EXACT,
    "silicone": Scene.silicone(),
    "in water": Scene(*_SILICONE, Weight(), Buoyancy(1000.0)),
    "payload": Scene(Extension(), ExactTendons(), TipLoad((0.0, 4e-3, -6e-3))),
    "sheared": Scene(*_SILICONE, Shear(), PointLoad(0.08, (0.0, 0.01, 0.0))),
    "current": Scene(*_SILICONE, Current((0.0, 0.05, 0.0))),
    "friction": Scene(*_SILICONE, Friction(0.1)),
}
# With the paper's tangent, or with a follower, no energy is minimal.
PAPER = {
    "paper": Scene(Extension()),
    "paper in water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "follower": Scene(Extension(), ExactTendons(), TipLoad((0.0, 4e-3, 0.0), follower=True)),
}
_PULLS = {"table-2": (0.5, 1.0, 2.5), "table-4": (0.1, 0.75, 2.0)}


def cylinder(sections: tuple[float, ...], y: float = 4e-3, R: float = 8e-3) -> Arm:
    """Return a cylinder with four tendons a section, parallel to its midline."""
    anchored = tuple(Anchorage(at, Linear(y, y)) for at in sections)
    return Arm(sections[0], Linear(R, R), anchored, Material(E=2e5))


def pulled(rng: np.random.Generator, name: str, slack: float = 0.4) -> tuple[Arm, Array]:
    """Return an arm and tensions, a fraction of which is 0; the arm is the paper's, or "random"."""
    if name != "random":
        arm = Arm.from_paper(name)
        T = rng.uniform(0, 1, 12) * np.repeat(_PULLS[name], 4)
    else:
        rod = random_rod(rng)
        arm = arm_of(rod)
        worth = [rod.E * np.pi * float(rod.radius(section.at)) ** 2 for section in rod.sections]
        counts = [len(section.angles) for section in rod.sections]
        T = rng.uniform(0, 0.2, sum(counts)) / sum(counts) * np.repeat(worth, counts)
    T[rng.uniform(0, 1, T.size) < slack] = 0.0
    return arm, T


def round_trip(
    rng: np.random.Generator, arm: Arm, T: Array, scene: Scene, accuracy: float = 1e-9
) -> tuple[Shape, Shape] | None:
    """Return the shape under tensions and the shape by its lengths, slack tendons random.

    Return None if the arm does not settle under the tensions.
    """
    try:
        given = settle(arm, T, scene, accuracy)
    except OctoplanError:
        return None
    lengths = given.tendon_lengths + (T == 0) * rng.uniform(1e-6, 1e-2, T.size)
    return given, settle(arm, scene=scene, accuracy=accuracy, lengths=lengths)


def check_complementary(shape: Shape, tolerance: float = 1e-10) -> None:
    """Assert that tendons have the lengths of their winches, or are slack without tension."""
    assert shape.winches is not None
    left = shape.winches.slack_lengths(shape.tendon_lengths, shape.tensions)
    L = shape.arm.length
    assert np.all(shape.tensions >= 0)
    assert np.all(left >= -tolerance * L)
    assert np.all(np.abs(left[shape.tensions > 0]) <= tolerance * L)
    assert np.array_equal(np.ravel(shape.slack), (shape.tensions == 0) & (left > tolerance * L))
