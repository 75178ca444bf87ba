"""The equations that the paper prints, and where they part from the consistent ones."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Extension, PrintedStatics
from model.statics import Statics, statics_of
from model.statics.sums import tendon_sums
from model.stations import stations
from model.unloaded.strain_equations import jump_function
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
PRINTED, CONSISTENT = Scene.as_printed(), Scene(Extension())
SEEDS = range(20)


def drawn(seed: int) -> tuple[Array, float, Array]:
    """Return random tensions, arc length and (tau, xi, k)."""
    rng = np.random.default_rng(seed)
    T = paper_tensions(rng, "table-4")
    return T, float(rng.uniform(0, ROD.length)), rng.uniform(-20, 20, 3)


@lru_cache(maxsize=2)
def rate_function(scene: Scene) -> ca.Function:
    statics: Statics = statics_of(scene, ARM)
    sizes = (len(statics.names), 6, 3, 6, 3)
    args = [ca.SX.sym(f"x{i}", n) for i, n in enumerate(sizes)]
    return ca.Function("rate", args, [statics.rate(*args)])


def model_rate(scene: Scene, T: Array, s: float, omega: Array) -> Array:
    at = stations(ARM, np.array([s]), np.array([ROD.active(s)]))
    sums, slopes = (rows[0] @ T for rows in tendon_sums(ARM, at))
    rate = rate_function(scene)(omega, sums, at.body[:, 0], slopes, at.body_rate[:, 0])
    return np.array(rate).ravel()


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
    assert np.allclose(model_rate(PRINTED, T, s, omega), wanted, rtol=1e-10, atol=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_with_torsion_the_printed_moments_lack_the_turning_of_the_frame(seed: int) -> None:
    T, s, omega = drawn(seed)
    D, m = balance(ROD, T, s, ROD.active(s))
    D_slope, m_slope = slope_of_balance(ROD, T, s)
    consistent = m_slope - D_slope @ omega + np.cross(omega, m - D @ omega)
    turning = np.cross(omega, body_stiffness(ROD, s) * omega)
    lacking = D @ model_rate(PRINTED, T, s, omega) - consistent
    size = np.linalg.norm(D @ model_rate(PRINTED, T, s, omega))
    assert np.linalg.norm(turning) > 1e-5 * size
    assert np.linalg.norm(lacking - turning) <= 1e-9 * size


@pytest.mark.parametrize("seed", SEEDS)
def test_without_torsion_the_printed_bending_is_the_consistent_one(seed: int) -> None:
    T, s, omega = drawn(seed)
    printed = model_rate(PRINTED, T, s, omega * [0, 1, 1])
    assert np.allclose(printed[1:], model_rate(CONSISTENT, T, s, omega[1:]), rtol=1e-10, atol=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_shape_in_balance_solves_the_printed_equations_between_anchorages(seed: int) -> None:
    T, s, _ = drawn(seed)
    omega = strain(ROD, T, s, False)[:3]
    D, _ = balance(ROD, T, s, ROD.active(s))
    D_slope, m_slope = slope_of_balance(ROD, T, s)
    wanted = np.linalg.solve(D, m_slope - D_slope @ omega)
    found = model_rate(PRINTED, T, s, omega)
    assert np.linalg.norm(found - wanted) <= 1e-9 * np.linalg.norm(wanted)


def jumps(T: Array, anchorage: int) -> tuple[Array, Array, Array]:
    """Return (xi, k) in balance beyond an anchorage, and after the printed and the true jump."""
    s = np.full(2, ROD.sections[anchorage].at)
    at = stations(ARM, s, np.array([anchorage, anchorage + 1]))
    outer, inner = tendon_sums(ARM, at)[0] @ T
    before = strain(ROD, T, s[0], False, anchorage)[:3]
    printed = jump_function(statics_of(PRINTED, ARM))(before, outer, inner, at.body[:, 0])
    true = jump_function(statics_of(CONSISTENT, ARM))(before[1:], outer, inner, at.body[:, 0])
    return before[1:], np.array(printed).ravel()[1:], np.array(true).ravel()


@pytest.mark.parametrize("seed", SEEDS)
def test_consistent_jump_leads_from_balance_to_balance(seed: int) -> None:
    T, _, _ = drawn(seed)
    for i, section in enumerate(ROD.sections):
        wanted = strain(ROD, T, section.at, False, i + 1)[1:3]
        assert np.allclose(jumps(T, i)[2], wanted, rtol=1e-12, atol=0)


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
