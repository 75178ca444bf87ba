"""Arms that snap, buckle, or fall to a side: told, and where they end."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import jv

from model import Arm, OctoplanError, Scene, SnapError, settle
from model.effects import ExactTendons, Extension, NeoHookean, TipLoad, Weight
from tests.effects.bars import NO_PULL, Bar, dead_elastica, elastica, follower_elastica
from tests.effects.cases import Array
from tests.effects.spatial import LoadedRod, Loads
from tests.oracles import paper_rod

BAR, CONICAL = Bar(), Bar(0.012, 0.005)
L, EJ = BAR.length, float(BAR.EJ(0.0))
UNIT = EJ / L**2


def euler(bar: Bar) -> float:
    """The least load along a cantilever at which EJ w'' + F w = 0 has a solution."""

    def clamp(load: float) -> float:
        def rate(s: float, y: Array) -> Array:
            return np.array([y[1], -load * y[0] / bar.EJ(s)])

        run = solve_ivp(rate, (bar.length, 0), [0.0, -1.0], "DOP853", rtol=1e-11, atol=1e-14)
        return float(run.y[1, -1])

    unit = bar.EJ(0.0) / bar.length**2
    low, high = 0.05 * unit, 3 * unit
    loads = np.linspace(low, high, 60)
    first = next(b for b in loads if clamp(b) > 0)
    return float(brentq(clamp, low, first, xtol=1e-14))


def column(bar: Bar) -> float:
    """The gravity at which a uniform column buckles under its own weight; Greenhill 1881."""
    root = brentq(lambda x: jv(-1 / 3, x), 1.5, 2.2, xtol=1e-14)
    return float((3 * root / 2) ** 2 * EJ / (bar.density * bar.A(0.0) * L**3))


def test_the_critical_loads_are_eulers_and_greenhills() -> None:
    assert euler(BAR) == pytest.approx(np.pi**2 * UNIT / 4, rel=1e-8)
    heavy = column(BAR) * BAR.density * BAR.A(0.0) * L**3 / EJ
    assert heavy == pytest.approx(7.83734744, rel=1e-8)


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


@pytest.mark.quick("0.98", "1.02")
@pytest.mark.parametrize("times", [0.98, 1.02, 3.0])
def test_a_column_buckles_under_its_own_weight(times: float) -> None:
    scene = Scene(Weight((-times * column(BAR), 0, 0)))
    if times < 1:
        assert np.allclose(settle(BAR.arm, NO_PULL, scene).tip, [L, 0, 0], rtol=0, atol=1e-12)
        return
    with pytest.raises(SnapError) as error:
        settle(BAR.arm, NO_PULL, scene)
    assert -1e-4 < 1 / times - error.value.load_factor <= 1 / 256


@pytest.mark.parametrize("share", [1.0, 100.0])
def test_a_push_that_follows_the_tip_buckles_no_static_bar(share: float) -> None:
    # Beck's column flutters at 8.1 times Euler's load, but has one equilibrium only.
    scene = Scene(TipLoad((-share * euler(BAR), 0, 0), follower=True))
    assert np.allclose(settle(BAR.arm, NO_PULL, scene).tip, [L, 0, 0], rtol=0, atol=1e-10)


def taut_elastica(alpha: float, s: Array) -> Array:
    """(x, y) under alpha EJ / L2 across the tip of a bar that is long for it: exp(-root) is 0.

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


def test_a_payload_of_a_hundred_times_what_bends_the_arm_settles() -> None:
    load = TipLoad((0.3, -2.0, 1.0))
    shape = settle(Arm.from_paper("table-4"), np.full(12, 0.05), Scene(load), 1e-4)
    along = np.array(load.force) / np.linalg.norm(load.force)
    assert np.linalg.norm(shape.tip - 0.45 * along) < 0.2 * 0.45


RANDOM = Arm.from_paper("table-4")
HEAVY = {
    "paper": (Extension(),),
    "bending": (),
    "silicone": (Extension(), ExactTendons(), NeoHookean()),
}


@pytest.mark.parametrize("times", [0.98, 1.5, 5.0])
def test_pushed_a_little_off_its_axis_it_gives_way_and_does_not_snap(times: float) -> None:
    force = times * euler(BAR) * np.array([-np.cos(0.1), np.sin(0.1)])
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad((*force, 0))), 1e-9)
    s = np.linspace(0, L, 7)
    found = elastica(BAR, lambda s: force, shares=16)(s)[:2]
    assert np.allclose(shape.position(s)[:, :2], found.T, rtol=0, atol=2e-9 * L)


def settles_or_says_why_not(name: str, seed: int) -> bool:
    rng = np.random.default_rng(seed)
    T = rng.uniform(size=(3, 4)) * [[0.2], [2], [5]] * (rng.uniform(size=(3, 4)) < 0.4)
    force = rng.normal(size=3) * 10 ** rng.uniform(-2, 1)
    scene = Scene(*HEAVY[name], TipLoad(tuple(force), follower=bool(seed % 2)))
    try:
        shape = settle(RANDOM, T, scene, 1e-4)
    except OctoplanError:
        return False
    assert np.linalg.norm(shape.tip) < 2 * RANDOM.length
    return True


@pytest.mark.slow
@pytest.mark.parametrize("name", HEAVY)
def test_no_payload_ends_in_another_error(name: str) -> None:
    for seed in range(12):
        settles_or_says_why_not(name, 100 + seed)


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
