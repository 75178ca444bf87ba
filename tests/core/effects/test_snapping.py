"""Arms that snap, buckle, or fall to a side: errors, and the shapes in which they end."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Scene, SnapError, settle
from octoplan.model.effects import Extension, TipLoad, Weight
from tests.core.effects.bars import NO_PULL, Bar, dead_elastica, euler, follower_elastica
from tests.core.effects.cases import Array
from tests.core.effects.spatial import LoadedRod, Loads
from tests.oracles import paper_rod

BAR, CONICAL = Bar(), Bar(0.012, 0.005)
L, EJ = BAR.length, float(BAR.EJ(0.0))
UNIT = EJ / L**2


@pytest.mark.quick("uniform-1.02", "conical-4")
@pytest.mark.parametrize(
    "times", [1.02, *(pytest.param(times, marks=pytest.mark.slow) for times in (1.3, 4, 16)), 30.0]
)
@pytest.mark.parametrize("bar", [BAR, CONICAL], ids=["uniform", "conical"])
def test_above_eulers_load_a_straight_bar_buckles(bar: Bar, times: float) -> None:
    scene = Scene(TipLoad((-times * euler(bar), 0, 0)))
    with pytest.raises(SnapError) as error:
        settle(bar.arm, NO_PULL, scene, 1e-8)
    # The last share that settled is less than a least step below the critical one.
    assert -1e-4 < 1 / times - error.value.load_factor <= 1 / 256
    copy = pickle.loads(pickle.dumps(error.value))
    assert (str(copy), copy.load_factor, copy.why) == (
        str(error.value),
        error.value.load_factor,
        error.value.why,
    )


@pytest.mark.parametrize("times", [0.5, 0.98])
@pytest.mark.parametrize("bar", [BAR, CONICAL], ids=["uniform", "conical"])
def test_below_eulers_load_it_stays_straight(bar: Bar, times: float) -> None:
    tip = settle(bar.arm, NO_PULL, Scene(TipLoad((-times * euler(bar), 0, 0))), 1e-8).tip
    assert np.allclose(tip, [L, 0, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("share", [1.0, 100.0])
def test_a_push_that_follows_the_tip_buckles_no_static_bar(share: float) -> None:
    # Beck's column flutters at 8.1 times Euler's load, but has one equilibrium only.
    scene = Scene(TipLoad((-share * euler(BAR), 0, 0), follower=True))
    assert np.allclose(settle(BAR.arm, NO_PULL, scene).tip, [L, 0, 0], rtol=0, atol=1e-10)


def taut_elastica(alpha: float, s: Array) -> Array:
    """Return (x, y) of a long bar under a transverse tip force alpha EJ / L2: exp(-root) is 0.

    The angle to the force is 4 atan(tan(pi / 8) exp(-root s / L)), root = sqrt(alpha).
    """
    root = np.sqrt(alpha)
    half = 2 * np.arctan(np.tan(np.pi / 8) * np.exp(-root * s / L))
    x = 2 * (np.sin(np.pi / 4) - np.sin(half))
    y = root * s / L - 2 * (np.cos(half) - np.cos(np.pi / 4))
    return L / root * np.array([x, y])


@pytest.mark.parametrize("alpha", [20.0, 50.0, 75.0, 110.0, 150.0, 400.0, 600.0])
def test_heavy_dead_loads_hang_straight_down(alpha: float) -> None:
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad((0, alpha * UNIT, 0))), 1e-8)
    s = np.linspace(0, L, 13)
    wanted = dead_elastica(alpha, s, L) if alpha < 200 else taut_elastica(alpha, s)
    assert np.allclose(shape.position(s)[:, :2], wanted.T, rtol=0, atol=1e-8 * L)
    assert abs(shape.tip_frame[0, 0]) < 0.1


@pytest.mark.parametrize("alpha", [30.0, 150.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_heavy_followers_wind_the_bar_up(alpha: float) -> None:
    force = alpha * UNIT
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad((0, -force, 0), follower=True)), 1e-7)
    s = np.linspace(0, L, 13)
    wanted = follower_elastica(BAR, force, s)
    assert np.allclose(shape.position(s)[:, :2], wanted, rtol=0, atol=2e-7 * L)


@pytest.mark.parametrize("g", [100.0, 300.0, 1000.0])
def test_what_hangs_straight_down_does_not_buckle(g: float) -> None:
    shape = settle(BAR.arm, NO_PULL, Scene(Extension(), Weight((g, 0, 0))))
    longer = BAR.density * g * L**2 / (2 * BAR.E)
    assert np.allclose(shape.tip, [L + longer, 0, 0], rtol=0, atol=1e-9)


# All in the x-y plane: the tendons on n and -n curl the arm through 203 degrees.
PULLS = [[0, 0, 0.2, 0], [1.0, 0, 0, 0], [0, 0, 3.0, 0]]
DOWN = np.array([0.0, -1.0, 0.0])
TOO_MUCH = 6e-3


def rod(load: float) -> LoadedRod:
    return LoadedRod(paper_rod("table-4"), np.ravel(PULLS), Loads(load * DOWN), extension=False)


def turn_of_base(load: float) -> Array:
    """Return the rotation (3, 3) of a free base per rotation of the tip of the settled arm."""
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


@pytest.mark.slow
def test_at_the_load_that_is_told_it_may_leave_its_plane() -> None:
    below, above = (turn_of_base(times * critical()) for times in (0.99, 1.01))
    for turn in (below, above):
        assert np.abs(turn[:2, 2]).max() < 1e-5
        assert turn[2, 2] > 0.1  # stable within the plane
    assert np.linalg.det(below[:2, :2]) > 0 > np.linalg.det(above[:2, :2])
