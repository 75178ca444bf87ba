"""First guesses by least squares over the bends: they meet what is wanted, each in its own way."""

from __future__ import annotations

from itertools import takewhile

import numpy as np
import pytest

from model import Arm, OctoplanError, Scene, settle
from planner import Limits
from planner.initial_guess.fitting import fitted, least_squares
from planner.initial_guess.many_arms import bend_coordinates
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


def test_a_squeeze_pulls_all_tendons_of_a_section_alike_and_bends_nothing() -> None:
    bends = bend_coordinates(ARM, frozenset(range(12)), Limits.of(ARM, MOST))
    T = bends.tensions(np.array([[0.0] * 6 + [0.0, 2.0, -1.0]])).reshape(3, 4)
    assert np.all(T[[0, 2]] == 0.0)
    assert np.all(T[1] == T[1, 0]) and T[1, 0] > 0
    assert np.linalg.norm(settle(ARM, T, PAPER).tip[1:]) < 1e-12


def test_least_squares_finds_the_solution_of_a_linear_system_from_many_points() -> None:
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(5, 3)), rng.normal(size=5)
    points, norms = least_squares(lambda U: U @ A.T - b, rng.normal(size=(7, 3)))
    best, residual = np.linalg.lstsq(A, b, rcond=None)[:2]
    assert np.allclose(points, best, atol=1e-5)
    assert np.allclose(norms, np.sqrt(residual[0]), rtol=1e-8)


def test_least_squares_follows_a_curved_valley() -> None:
    def rosenbrock(U: Array) -> Array:
        return np.stack([10 * (U[:, 1] - U[:, 0] ** 2), 1 - U[:, 0]], axis=1)

    points, norms = least_squares(rosenbrock, np.array([[0.7, 0.2], [1.5, 2.0], [2.0, 3.0]]))
    assert np.allclose(points, 1.0, atol=1e-4)
    assert np.all(norms < 1e-4)


def test_least_squares_stays_where_gaps_jump_and_do_not_depend_on_all() -> None:
    """The slope of a jump is so steep that damping is lost in rounding beside it."""

    def gaps(U: Array) -> Array:
        return np.where(U[:, :1] + U[:, 1:2] > 0, 1e3, 1.0) * np.ones(4)

    points, norms = least_squares(gaps, np.array([[0.0, 0.0, 1.0], [-1.0, 0.5, 2.0]]))
    assert np.all(np.isfinite(points)) and np.all(norms <= 2.0)
