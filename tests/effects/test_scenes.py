"""Which effects go together; plans with them; what is not enabled is not there."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, OctoplanError, Scene, settle
from model.effects import Extension
from planner import plan
from planner.targets import BendingPlane, TipPosition
from tests.effects.cases import EXACT, SILICONE, SWOLLEN

ARM = Arm.from_paper("table-4")


@pytest.mark.quick("silicone")
@pytest.mark.parametrize("scene", [EXACT, SILICONE, SWOLLEN], ids=["exact", "silicone", "shift"])
def test_a_tip_is_planned_and_certified(scene: Scene) -> None:
    T = np.zeros((3, 4))
    T[0, 1], T[1, 2], T[2, 0] = 0.05, 0.8, 1.5
    point = settle(ARM, T, scene, 1e-9).tip
    found = plan(ARM, TipPosition(tuple(point)), scene, 20.0)
    assert found.certificate.passed, found.outcome
    assert np.linalg.norm(found.shape.tip - point) < 1e-6 * ARM.length
    assert found.effort <= np.linalg.norm(T) * (1 + 1e-9)


def test_with_exact_tendons_the_law_of_the_bending_plane_is_nearly_exact() -> None:
    arm, angle = Arm.from_paper("table-2"), np.radians(-30)
    T = np.zeros((3, 4))
    T[0, :2] = 2 * np.array([np.sin(-angle), np.cos(angle)])
    gaps = {}
    for name, scene in (("paper", Scene(Extension())), ("exact", EXACT)):
        tip = settle(arm, T, scene, 1e-9).tip
        gaps[name] = abs(np.degrees(np.arctan2(tip[1], -tip[2]) - angle))
    assert gaps["paper"] == pytest.approx(0.258, abs=1e-3)
    assert gaps["exact"] < 1e-3


def test_a_bend_of_silicone_is_planned() -> None:
    found = plan(Arm.from_paper("table-2"), BendingPlane(0.4, 1.2, 2), SILICONE, 20.0)
    assert found.certificate.passed, found.outcome


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 30.0])
def test_rubber_settles_or_says_why_not_under_any_pull(scale: float) -> None:
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0], T[2, 1] = 0.5 * scale, 4 * scale, 13 * scale
    try:
        shape = settle(ARM, T, SILICONE, 1e-6)
    except OctoplanError:
        assert scale > 1
    else:
        assert shape.strain(np.linspace(0, 0.45, 50))[:, 3].min() > -1
