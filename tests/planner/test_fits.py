"""First guesses by least squares over the bends: they meet what is wanted, each in its own way."""

from __future__ import annotations

from itertools import takewhile

import numpy as np
import pytest

from model import Arm, OctoplanError, Scene, settle
from planner import Limits
from planner.initial_guess.fitting import fitted
from planner.targets import TipPose
from tests.planner.cases import PAPER, Array

ARM = Arm.from_paper("table-4")
MOST = 10.0


def posed(arm: Arm, scene: Scene, T: Array) -> TipPose:
    shape = settle(arm, T, scene, 1e-9)
    return TipPose(tuple(shape.tip.tolist()), tuple(tuple(row) for row in shape.tip_frame.tolist()))


def off(T: Array, scene: Scene, target: TipPose) -> float:
    try:
        return float(np.linalg.norm(settle(ARM, T, scene, 1e-4).tip - target.position))
    except OctoplanError:
        return np.inf


@pytest.mark.parametrize("scene", [PAPER, Scene()], ids=["paper", "bare"])
def test_fits_meet_a_pose_cheapest_first_in_ways_that_differ(scene: Scene) -> None:
    T = np.array([[0.0, 0.0, 0.18, 0.05], [0.0, 0.9, 0.0, 0.0], [2.0, 0.0, 0.0, 1.0]])
    target = posed(ARM, scene, T)
    every = fitted(ARM, scene, (target,), Limits.of(ARM, MOST), False)
    found = list(takewhile(lambda one: off(one, scene, target) < 0.03 * ARM.length, every))
    assert found
    efforts = [float(np.linalg.norm(one)) for one in found]
    assert efforts == sorted(efforts)
    assert efforts[0] <= np.linalg.norm(T) * 1.02
    for one in found:
        assert np.all((one >= 0) & (one <= MOST))
    for i, one in enumerate(found):
        assert all(np.abs(one - other).max() > 0.01 for other in found[:i])
