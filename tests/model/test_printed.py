"""The equations that the paper prints, and where they part from the consistent ones."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import PrintedStatics
from model.unloaded.printed import section_numbers, strain_jump, strain_rate
from tests.model.cases import paper_tensions
from tests.oracles import (
    Array,
    Rod,
    balance,
    body_stiffness,
    paper_rod,
    paper_sums,
    printed_rate,
    printed_states,
    strain,
)

ROD, ARM = paper_rod("table-4"), Arm.from_paper("table-4")
PRINTED = Scene.as_printed()
SEEDS = range(20)


def drawn(seed: int) -> tuple[Array, float, Array]:
    """Return random tensions, arc length and (tau, xi, k)."""
    rng = np.random.default_rng(seed)
    T = paper_tensions(rng, "table-4")
    return T, float(rng.uniform(0, ROD.length)), rng.uniform(-20, 20, 3)


@lru_cache(maxsize=1)
def rate_function() -> ca.Function:
    """Return (tau, xi, k; numbers of a cross-section) -> their rates."""
    strain, d = ca.SX.sym("strain", 3), ca.SX.sym("d", 18)
    return ca.Function("rate", [strain, d], [strain_rate(strain, d[:6], d[6:12], d[12:15], d[15:])])


def numbers(T: Array, s: Array, active: Array) -> ca.DM:
    """Return the numbers (18, N) of cross-sections."""
    given = ca.MX.sym("T", 12)
    return ca.Function("numbers", [given], [section_numbers(ARM, s, active, given)])(T)


def model_rate(T: Array, s: float, omega: Array) -> Array:
    d = numbers(T, np.array([s]), np.array([ROD.active(s)]))
    return np.array(rate_function()(omega, d)).ravel()


def slope_of_balance(rod: Rod, T: Array, s: float) -> tuple[Array, Array]:
    """Return D' and m'; both are quartic in s at most, so that five points are exact."""
    h, active = 1e-2, rod.active(s)
    rows = [balance(rod, T, s + i * h, active) for i in (-2, -1, 1, 2)]
    D, m = zip(*rows, strict=True)
    weights = np.array([1, -8, 8, -1]) / (12 * h)
    return np.tensordot(weights, D, 1), np.tensordot(weights, m, 1)


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_is_equation_10(seed: int) -> None:
    T, s, omega = drawn(seed)
    wanted = printed_rate(ROD, T, s, omega, ROD.active(s))
    assert np.allclose(model_rate(T, s, omega), wanted, rtol=1e-10, atol=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_with_torsion_the_printed_moments_lack_the_turning_of_the_frame(seed: int) -> None:
    T, s, omega = drawn(seed)
    D, m = balance(ROD, T, s, ROD.active(s))
    D_slope, m_slope = slope_of_balance(ROD, T, s)
    consistent = m_slope - D_slope @ omega + np.cross(omega, m - D @ omega)
    turning = np.cross(omega, body_stiffness(ROD, s) * omega)
    lacking = D @ model_rate(T, s, omega) - consistent
    size = np.linalg.norm(D @ model_rate(T, s, omega))
    assert np.linalg.norm(turning) > 1e-5 * size
    assert np.linalg.norm(lacking - turning) <= 1e-9 * size


@pytest.mark.parametrize("seed", SEEDS)
def test_without_torsion_the_printed_bending_is_the_consistent_one(seed: int) -> None:
    T, s, omega = drawn(seed)
    omega = omega * [0, 1, 1]
    D, _ = balance(ROD, T, s, ROD.active(s))
    D_slope, m_slope = slope_of_balance(ROD, T, s)
    wanted = np.linalg.solve(D, m_slope - D_slope @ omega)
    found = model_rate(T, s, omega)
    assert np.linalg.norm(found[1:] - wanted[1:]) <= 1e-9 * np.linalg.norm(wanted)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_shape_in_balance_solves_the_printed_equations_between_anchorages(seed: int) -> None:
    T, s, _ = drawn(seed)
    omega = strain(ROD, T, s, False)[:3]
    D, _ = balance(ROD, T, s, ROD.active(s))
    D_slope, m_slope = slope_of_balance(ROD, T, s)
    wanted = np.linalg.solve(D, m_slope - D_slope @ omega)
    found = model_rate(T, s, omega)
    assert np.linalg.norm(found - wanted) <= 1e-9 * np.linalg.norm(wanted)


def jumps(T: Array, anchorage: int) -> tuple[Array, Array, Array]:
    """Return (xi, k) in balance beyond an anchorage, and after the printed and the true jump."""
    s = ROD.sections[anchorage].at
    d = numbers(T, np.full(2, s), np.array([anchorage, anchorage + 1]))
    before = strain(ROD, T, s, False, anchorage)[1:3]
    gained = np.array(ca.evalf(strain_jump(ca.SX(d[:6, 0]), ca.SX(d[:6, 1]), ca.SX(d[12:15, 1]))))
    return before, before + gained.ravel()[1:], strain(ROD, T, s, False, anchorage + 1)[1:3]


@pytest.mark.parametrize("seed", SEEDS)
def test_printed_jump_is_right_for_a_single_anchorage(seed: int) -> None:
    T, _, _ = drawn(seed)
    _, printed, true = jumps(T, 0)
    assert np.allclose(printed, true, rtol=1e-12, atol=0)
    for alone in (1, 2):
        only = np.where(np.arange(12) // 4 == alone, T, 0)
        before, printed, true = jumps(only, alone)
        assert np.all(before == 0)
        assert np.allclose(printed, true, rtol=1e-12, atol=0)


@pytest.mark.parametrize("anchorage", [1, 2])
@pytest.mark.parametrize("seed", SEEDS[:5])
def test_printed_jump_is_wrong_to_first_order_where_other_tendons_cross(
    seed: int, anchorage: int
) -> None:
    T, _, _ = drawn(seed)
    small = 1e-4 * T
    s = ROD.sections[anchorage].at
    beyond = paper_sums(ROD, small, s, anchorage)[0]
    own = paper_sums(ROD, small, s, anchorage + 1)[0] - beyond
    EJ = body_stiffness(ROD, s)[1]
    before, printed, true = jumps(small, anchorage)
    pull = np.array([own[1, 3] - own[1, 1], own[1, 0] - own[1, 2]])
    stiff = np.array([[z[2, 1] + z[2, 3], z[2, 0] + z[2, 2]] for z in (own, beyond)]) / EJ
    wanted = before * stiff[0] + pull / EJ * stiff[1]
    assert np.all(np.abs(wanted) > 0)
    assert np.allclose(printed - true, wanted, rtol=1e-3, atol=0)


@pytest.mark.parametrize("seed", SEEDS[:3])
def test_printed_scene_settles_to_what_its_equations_integrate_to(seed: int) -> None:
    T, _, _ = drawn(seed)
    s = np.unique([0.0, 0.05, 0.135, 0.2, 0.315, 0.4, 0.45])
    shape = settle(ARM, T, PRINTED, accuracy=1e-10)
    strains, position, frame = printed_states(ROD, T, s)
    gap = np.linalg.norm((shape.strain(s) - strains)[:, :3], axis=1)
    assert np.abs(strains[:-1, 0]).max() > 1e-3
    assert np.all(gap <= 1e-7 * np.linalg.norm(strains[:, :3], axis=1))
    assert np.abs(shape.strain(s)[:, 3] - strains[:, 3]).max() <= 1e-8
    assert np.linalg.norm(shape.position(s) - position, axis=1).max() <= 1e-9 * ROD.length
    assert np.abs(shape.frame(s) - frame).max() <= 1e-8


def test_printed_statics_without_extension_bend_alike_and_shorten_nothing() -> None:
    T, _, _ = drawn(0)
    s = np.linspace(0, ROD.length, 9)
    with_q = settle(ARM, T, PRINTED, accuracy=1e-9)
    without = settle(ARM, T, Scene(PrintedStatics()), accuracy=1e-9)
    assert np.all(without.strain(s)[:, 3] == 0)
    assert np.all(with_q.strain(s)[:, 3] < -0.02)
    gap = np.linalg.norm((without.strain(s) - with_q.strain(s))[:, :3], axis=1)
    assert np.all(gap <= 1e-5 * np.linalg.norm(with_q.strain(s)[:, :3], axis=1))
    assert np.any(without.strain(s)[:, 0] != 0)
