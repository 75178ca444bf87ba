"""A curled arm that a payload in its plane pushes out of that plane, against shooting in SciPy."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model import Arm, Scene, SnapError, settle
from model.effects import TipLoad
from tests.effects.cases import Array
from tests.effects.spatial import LoadedRod, Loads
from tests.oracles import paper_rod

# All in the x-y plane: the tendons on n and -n curl the arm through 203 degrees.
PULLS = [[0, 0, 0.2, 0], [1.0, 0, 0, 0], [0, 0, 3.0, 0]]
DOWN = np.array([0.0, -1.0, 0.0])
TOO_MUCH = 6e-3


def rod(load: float) -> LoadedRod:
    return LoadedRod(paper_rod("table-4"), np.ravel(PULLS), Loads(load * DOWN), extension=False)


def turn_of_base(load: float) -> Array:
    """How the base, let go, turns (3, 3) where the tip of the settled arm is turned a little."""
    held = rod(load)
    tip = held.settle(2)
    columns = []
    for axis in np.eye(3):
        ends = [held.gap(Rotation.from_rotvec(h * axis).as_matrix() @ tip) for h in (1e-4, -1e-4)]
        columns.append((ends[0] - ends[1]) / 2e-4)
    return np.array(columns).T


@cache
def critical() -> float:
    arm = Arm.from_paper("table-4")
    with pytest.raises(SnapError) as error:
        settle(arm, PULLS, Scene(TipLoad(tuple(TOO_MUCH * DOWN))), 1e-6)
    return error.value.load_factor * TOO_MUCH


@pytest.mark.slow
def test_the_arm_keeps_to_its_plane_below_the_load_that_is_told() -> None:
    arm, load = Arm.from_paper("table-4"), 0.99 * critical()
    shape = settle(arm, PULLS, Scene(TipLoad(tuple(load * DOWN))), 1e-8)
    u, R = rod(load).poses((0.2, 0.45), shares=2)
    assert np.allclose(shape.position([0.2, 0.45]), u, rtol=0, atol=1e-8)
    assert np.allclose(shape.frame([0.2, 0.45]), R, rtol=0, atol=1e-6)
    assert abs(shape.tip[2]) < 1e-12


def test_at_the_load_that_is_told_it_may_leave_its_plane() -> None:
    below, above = (turn_of_base(times * critical()) for times in (0.99, 1.01))
    for turn in (below, above):
        assert np.abs(turn[:2, 2]).max() < 1e-5
        assert turn[2, 2] > 0.1  # within the plane it is well held
    assert np.linalg.det(below[:2, :2]) > 0 > np.linalg.det(above[:2, :2])
