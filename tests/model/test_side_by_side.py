"""Many sets of tensions under loads settle side by side as each does alone."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from model import Arm, Scene, settle, settle_many
from model.clearance.lines import Lines
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
from model.equilibrium import continuation
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
def test_sets_side_by_side_are_those_settled_alone(name: str) -> None:
    arm, scene, T = Arm.from_paper("table-4"), SCENES[name], sets(11, 3)
    many = settle_many(arm, T, scene, compile=True)
    for i, row in enumerate(T):
        alone = settle(arm, row, scene)
        assert many.tip[i] == pytest.approx(alone.tip, abs=1e-11)
        assert many.tip_frame[i] == pytest.approx(alone.tip_frame, abs=1e-10)
        assert many.error[i] == pytest.approx(alone.error, rel=1e-2, abs=1e-11)


def test_sets_whose_loads_come_in_steps_end_on_the_same_branch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arm, scene, shares = Arm.from_paper("table-4"), SCENES["silicone, a mass off the axis"], []
    newton_many = continuation.newton_many

    def seen(system: object, tensions: Array, load: Array, *given: object, **how: object) -> object:
        shares.extend(np.asarray(load).tolist())
        return newton_many(system, tensions, load, *given, **how)  # type: ignore[arg-type]

    T = sets(40, 5)
    with monkeypatch.context() as changed:
        changed.setattr(continuation, "newton_many", seen)
        many = settle_many(arm, T, scene)
    assert 3 < sum(share < 1 for share in shares) < 80
    alone = np.array([settle(arm, row, scene).tip for row in T])
    assert np.abs(many.tip - alone).max() < 1e-11


def test_what_buckles_is_refused_as_it_is_alone() -> None:
    arm, scene = Arm.from_paper("table-4"), Scene(TipLoad((-1.0, 0.0, 0.0)))
    T = np.zeros((3, arm.n_tendons))
    T[[0, 2], 1] = 0.3
    with pytest.raises(SnapError) as refused:
        settle(arm, T[1], scene)
    many = settle_many(arm, T, scene, compile=True, errors="nan")
    assert many.problems == ("", str(refused.value), "")
    assert np.isnan(many.tip).all(axis=1).tolist() == [False, True, False]


def test_centrelines_on_a_way_are_those_followed_one_by_one() -> None:
    arm, scene = Arm.from_paper("table-4"), SCENES["silicone, a mass off the axis"]
    ends = sets(2, 7)
    way = ends[0] + np.linspace(0, 1, 14)[:, None] * (ends[1] - ends[0])
    compiled, plain = (Lines(arm, scene, 2, (), how).many(way) for how in (True, False))
    for one, other in zip(compiled, plain, strict=True):
        assert one is not None and other is not None
        assert one.poses == pytest.approx(other.poses, abs=1e-10)
