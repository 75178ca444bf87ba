"""Why strains are integrated from tip to base: an error shrinks that way and grows the other."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from model import Arm
from model.integrators import RK6
from model.mesh import graded
from model.unloaded.printed import section_numbers, step_function
from tests.oracles import (
    Array,
    Rod,
    RodSection,
    balance,
    linear,
    paper_rod,
    printed_rate,
    strain,
)

PULL = np.array([0, 0, 0.3, 0.0])
ERROR = 1e-6


def one_section() -> Rod:
    """Return the body of table 4 with its tip's tendons alone."""
    body = paper_rod("table-4")
    return Rod(body.length, body.radius, body.sections[:1])


def carried(rod: Rod, start: float, end: float, omega: Array) -> Array:
    """Return (xi, k) at end, integrated from start: eq. (10), where torsion stays 0."""

    def rate(s: float, x: Array) -> Array:
        return printed_rate(rod, PULL, s, np.append(0, x), 1)[1:]

    run = solve_ivp(rate, (start, end), omega, "DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(run.y[:, -1])


def stiffness_ratio(rod: Rod) -> Array:
    """Return D(tip) / D(base) about n and about b."""
    tip, base = (np.diag(balance(rod, PULL, s, 1)[0])[1:] for s in (rod.length, 0.0))
    return np.asarray(tip / base)


def error_growth(rod: Rod, start: float, end: float) -> Array:
    """Return the factors by which errors in xi and in k grow on the way."""
    omega = strain(rod, PULL, start, False)[1:3]
    right = carried(rod, start, end, omega)
    scale = ERROR * np.linalg.norm(omega)
    errors = [carried(rod, start, end, omega + scale * unit) - right for unit in np.eye(2)]
    return np.diag(errors) / scale


def test_an_error_made_at_the_tip_decays_towards_the_base() -> None:
    rod = one_section()
    growth = error_growth(rod, rod.length, 0.0)
    assert np.allclose(growth, stiffness_ratio(rod), rtol=1e-3)
    assert np.all(growth < 1e-3)


def test_an_error_made_at_the_base_grows_by_the_inverse_towards_the_tip() -> None:
    rod = one_section()
    growth = error_growth(rod, 0.0, rod.length)
    assert np.allclose(growth, 1 / stiffness_ratio(rod), rtol=1e-3)
    assert np.all(growth > 1000)


def test_without_tension_the_ratio_is_that_of_the_fourth_powers_of_the_radii() -> None:
    rod = one_section()
    ends = (np.diag(balance(rod, 0 * PULL, s, 1)[0])[1] for s in (rod.length, 0.0))
    assert next(ends) / next(ends) == pytest.approx((2 / 15) ** 4)
    assert pytest.approx(3164, abs=1) == 1 / (2 / 15) ** 4


def test_the_model_carries_errors_from_tip_to_base_by_the_same_factor() -> None:
    """In the plane of bending, where printed and consistent equations of one anchorage agree."""
    paper = Arm.from_paper("table-4")
    arm = Arm(paper.length, paper.radius, paper.sections[:1])
    nodes = graded(arm, 16).s[::-1]
    T, x = ca.MX.sym("T", 4), ca.MX.sym("x", 10)
    samples, h = np.array(RK6.samples), np.diff(nodes)
    s = (nodes[:-1, None] + h[:, None] * samples).ravel()
    d = section_numbers(arm, s, np.ones(s.size, int), T)
    after = step_function(False, RK6).mapaccum(h.size)(x, d, ca.DM(h).T)[7:, -1]
    slope = ca.Function("slope", [x, T], [ca.jacobian(after, x)[2, 9]])
    start = np.concatenate([[1, 0, 0, 0, 0, 0, 0], strain(one_section(), PULL, 0.45, False)[:3]])
    assert float(slope(start, PULL)) == pytest.approx(stiffness_ratio(one_section())[1], rel=1e-6)


def test_a_cylinder_neither_damps_nor_amplifies() -> None:
    even = linear(5e-3, 5e-3, 0.3)
    rod = Rod(0.3, even, (RodSection(0.3, linear(2e-3, 2e-3, 0.3)),))
    assert np.allclose(error_growth(rod, 0.3, 0.0), 1, rtol=1e-6)
