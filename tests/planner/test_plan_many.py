"""Plans for many targets of which some are not allowed."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, InputError, OctoplanError, Scene
from model.effects import Extension
from planner import FailedPlan, plan_many
from planner.targets import BendingPlane, TipPosition

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())
TARGETS = [BendingPlane(2.0, 0.9), BendingPlane(2.0, 1.0, section=7), BendingPlane(2.0, 1.1)]


def test_a_bad_target_does_not_lose_the_others() -> None:
    found = plan_many(ARM, TARGETS, SCENE, 20.0, accuracy=1e-5, errors="nan")
    assert [p.reached for p in found] == [True, False, True]
    lost = found[1]
    assert isinstance(lost, FailedPlan)
    assert lost.reason.startswith("targets[1]: section: got 7")
    assert lost.outcome == f"Not certified: {lost.reason}."
    assert np.isnan(np.array([p.tip for p in found])).any(axis=1).tolist() == [False, True, False]
    assert np.shape([p.tensions for p in found]) == (3, 3, 4)
    assert np.isnan(lost.lengths).all() and np.isnan(lost.strokes).all() and np.isnan(lost.effort)
    assert lost.reason in repr(lost)
    with pytest.raises(OctoplanError, match="section: got 7"):
        _ = lost.shape


def test_without_it_the_target_is_named() -> None:
    with pytest.raises(InputError, match=r"targets\[0\]: section"):
        plan_many(ARM, TARGETS[1:], SCENE, 20.0)
    with pytest.raises(InputError, match="errors"):
        plan_many(ARM, TARGETS, SCENE, 20.0, errors="skip")  # type: ignore[arg-type]


def test_what_is_wrong_whatever_the_target_is_raised() -> None:
    with pytest.raises(InputError, match="tension_max"):
        plan_many(ARM, [TipPosition((0.3, 0.1, 0.0))], SCENE, -1.0, errors="nan")
