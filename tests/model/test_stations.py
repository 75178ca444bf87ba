"""Numbers of cross-sections: stiffness, offsets, and their derivatives along the arm."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from model.stations import Stations, stations
from model.unloaded.printed import section_numbers
from model.unloaded.statics import resultant_maps
from tests.model.cases import arm_of, mild_tensions, random_rod
from tests.oracles import Array, Rod, balance, body_stiffness

SEEDS = range(10)
STEP = 1e-4


def drawn(seed: int) -> tuple[Rod, float, int]:
    """Return a rod, an arc length well inside a smooth stretch of it, and what crosses there."""
    rng = np.random.default_rng(seed)
    rod = random_rod(rng)
    ends = rod.breaks()
    i = rng.integers(ends.size - 1)
    s = ends[i] + rng.uniform(0.3, 0.7) * (ends[i + 1] - ends[i])
    return rod, float(s), rod.active(s)


def around(rod: Rod, s: float, active: int) -> Stations:
    """Return five stations about s."""
    return stations(arm_of(rod), s + STEP * np.arange(-2, 3), np.full(5, active))


def slope(values: Array) -> Array:
    """Return the derivative along the last axis, five values a step apart, exact for quartics."""
    return np.asarray(values @ np.array([1, -8, 0, 8, -1]) / (12 * STEP))


@pytest.mark.parametrize("seed", SEEDS)
def test_body_has_the_stiffness_of_a_round_section(seed: int) -> None:
    rod, s, active = drawn(seed)
    GI, EJ, _ = body_stiffness(rod, s)
    EA = rod.E * np.pi * float(rod.radius(s)) ** 2
    assert np.allclose(around(rod, s, active).body[:, 2], [EA, EJ, GI], rtol=1e-12, atol=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_rates_are_the_derivatives_along_the_arm(seed: int) -> None:
    at = around(*drawn(seed))
    size = np.abs(at.body[:, 2]) / STEP
    assert np.all(np.abs(at.body_rate[:, 2] - slope(at.body)) <= 1e-13 * size)
    assert np.abs(at.y_rate[:, 2] - slope(at.y)).max() <= 1e-12
    assert np.abs(at.y_curve[:, 2] - slope(at.y_rate)).max() <= 1e-9
    arm = arm_of(drawn(seed)[0])
    T = ca.MX.sym("T", arm.n_tendons)
    numbers = ca.jacobian(section_numbers(arm, at.s, at.active, T), T)
    rows = np.array(ca.Function("rows", [T], [ca.densify(numbers)])(0)).reshape(-1, 18, T.numel())
    sums = np.moveaxis(rows, 0, -1)
    assert np.abs(sums[6:12, :, 2] - slope(sums[:6])).max() <= 1e-12


def test_random_bodies_and_offsets_do_change_along_the_arm() -> None:
    drawings = [around(*drawn(seed)) for seed in SEEDS]
    assert all(np.all(at.body_rate[:, 2] < 0) for at in drawings)
    assert sum(bool(np.any(at.y_rate != 0)) for at in drawings) >= 5
    assert sum(bool(np.any(at.y_curve != 0)) for at in drawings) >= 2


@pytest.mark.parametrize("seed", SEEDS)
def test_sums_over_tendons_make_the_balance_of_moments(seed: int) -> None:
    rod, s, active = drawn(seed)
    T = mild_tensions(np.random.default_rng(seed), rod)
    D, m = balance(rod, T, s, active)
    _, c, sine, cc, sc, ss = resultant_maps(arm_of(rod), around(rod, s, active))[2] @ T
    EJ = body_stiffness(rod, s)[1]
    assert np.allclose([[ss, -sc], [-sc, cc]], D[1:, 1:] - EJ * np.eye(2), atol=1e-12 * EJ)
    assert np.allclose([-sine, c], m[1:], rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("seed", SEEDS)
def test_tendons_beyond_their_anchorage_add_nothing(seed: int) -> None:
    rod, s, active = drawn(seed)
    arm, at = arm_of(rod), around(rod, s, active)
    idle = [j for j, (section, _) in enumerate(arm.tendons) if section >= active]
    rows = resultant_maps(arm, at)
    assert np.all(rows[:, :, idle] == 0)
    assert rows.shape == (5, 6, arm.n_tendons)
    assert np.all(at.y[active:] == 0)
