"""Many sets of tensions under loads settle as each does alone, compiled or not."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from model import Arm, Scene, settle, settle_many
from model.effects import (
    Buoyancy,
    Current,
    Extension,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from model.errors import SnapError
from model.paths import Array

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

WATER = (Weight(), Buoyancy(1000.0))
OFF_AXIS = PointMass(0.12, 0.004, (0.0, 0.006, 0.002))
FOLLOWER = TipLoad((0.004, 0.01, 0.02), (0.0, 1e-4, 2e-4), follower=True)
STREAM = Current((0.1, 0.0, 0.05), density=1000.0, coefficient=1.1)
SCENES = {
    "silicone, a mass off the axis": Scene.silicone(*WATER, OFF_AXIS),
    "the paper's tendons in a stream": Scene(Extension(), *WATER, STREAM),
    "silicone, a follower": Scene.silicone(Weight(), FOLLOWER),
    "bare, loads in the air": Scene(TipLoad((0.0, 0.05, 0.02)), PointLoad(0.1, (0.0, 0.0, 0.02))),
    "silicone with shear": Scene.silicone(*WATER, Shear()),
}
QUICK = ("silicone, a mass off the axis", "the paper's tendons in a stream")


def sets(count: int, seed: int) -> Array:
    """Return tensions (count, 12) that bend and roll up the arm of table 4."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 0.5, (count, 12)) * np.repeat([0.3, 2.0, 6.0], 4)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in SCENES]
)
def test_many_sets_are_those_settled_alone(name: str) -> None:
    arm, scene, T = Arm.from_paper("table-4"), SCENES[name], sets(11, 3)
    many = settle_many(arm, T, scene, compile=True)
    for i, row in enumerate(T):
        alone = settle(arm, row, scene)
        assert many.tip[i] == pytest.approx(alone.tip, abs=1e-11)
        assert many.tip_frame[i] == pytest.approx(alone.tip_frame, abs=1e-10)
        assert many.error[i] == pytest.approx(alone.error, rel=1e-2, abs=1e-11)


def test_what_buckles_is_refused_as_it_is_alone() -> None:
    arm, scene = Arm.from_paper("section-5.2"), Scene(TipLoad((-0.5, 0.0, 0.0)))
    T = np.zeros((3, arm.n_tendons))
    T[[0, 2], 1] = 0.3
    with pytest.raises(SnapError) as refused:
        settle(arm, T[1], scene)
    many = settle_many(arm, T, scene, compile=True, errors="nan")
    assert many.problems == ("", str(refused.value), "")
    assert np.isnan(many.tip).all(axis=1).tolist() == [False, True, False]
