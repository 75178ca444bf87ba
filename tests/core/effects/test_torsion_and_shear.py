"""Torsion out of the bending plane, shear of thick bars, and loaded arms of finite elements."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.integrate import quad

from octoplan.model import Anchorage, Arm, Linear, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, PointLoad, Shear, TipLoad
from tests.core.effects.bars import NO_PULL, Bar
from tests.core.effects.cases import DATA, RODS, fem_arm
from tests.oracles import balance, paper_rod

THICK = {"uniform": Bar(0.03, 0.03, 0.1), "conical": Bar(0.03, 0.012, 0.1)}
TANGENTS = pytest.mark.parametrize("more", [(), (ExactTendons(),)], ids=["paper", "exact"])


def flexibility(bar: Bar, k_s: float) -> float:
    """Return the deflection of the tip per transverse unit force, by bending and by shear."""
    bending = quad(lambda s: (bar.length - s) ** 2 / bar.EJ(s), 0, bar.length, epsrel=1e-13)[0]
    G = bar.E / (2 * (1 + bar.nu))
    return float(bending + quad(lambda s: 1 / (k_s * G * bar.A(s)), 0, bar.length)[0])


@TANGENTS
@pytest.mark.parametrize("k_s", [1.0, 0.5, 0.886])
@pytest.mark.parametrize("name", THICK)
def test_a_thick_cantilever_gives_by_bending_and_by_shear(
    name: str, k_s: float, more: tuple[Any, ...]
) -> None:
    bar, F = THICK[name], 1e-4
    tip = settle(bar.arm, NO_PULL, Scene(Shear(k_s), TipLoad((0, F, 0)), *more), 1e-12).tip
    assert tip[1] == pytest.approx(F * flexibility(bar, k_s), rel=1e-7)
    if name == "uniform":
        L, EJ, GA = 0.1, bar.EJ(0.0), bar.E / 3 * bar.A(0.0)
        assert tip[1] == pytest.approx(F * (L**3 / (3 * EJ) + L / (k_s * GA)), rel=1e-7)


@TANGENTS
def test_a_cross_section_that_slides_does_not_turn(more: tuple[Any, ...]) -> None:
    bar, F = THICK["uniform"], 1e-4
    load = TipLoad((0, F, 0))
    with_it, without = (
        settle(bar.arm, NO_PULL, Scene(load, *more, *shear), 1e-12).tip_frame
        for shear in ((Shear(),), ())
    )
    assert np.allclose(with_it, without, rtol=0, atol=1e-9)
    turn = F * 0.1**2 / (2 * bar.EJ(0.0))
    assert with_it[1, 0] == pytest.approx(turn, rel=1e-6)


def test_an_arm_without_load_across_does_not_slide() -> None:
    arm, T = Arm.from_paper("table-2"), np.zeros((3, 4))
    for tendons in ((), (ExactTendons(),)):
        straight = settle(arm, T, Scene(Extension(), Shear(), *tendons), 1e-10).tip
        assert np.allclose(straight, [0.31, 0, 0], rtol=0, atol=1e-15)
    flat = Arm(0.3, Linear(0.012, 0.006), (Anchorage(0.3, Linear(4e-3, 4e-3)),))
    pulls = [[0.3, 0.2, 0, 0]]
    tips = [settle(flat, pulls, Scene(Extension(), *s), 1e-10).tip for s in ((Shear(),), ())]
    # Parallel tendons pull along t: the paper's tangent has no part across.
    assert np.allclose(tips[0], tips[1], rtol=0, atol=1e-10)


LOADED = [
    case
    for case in json.loads((DATA / "fem_reference.json").read_text())["cases"]
    if case["label"].endswith("F1e-3")
]


def settled(case: dict[str, Any], rod: str) -> Shape:
    arm, T = fem_arm(case)
    load = TipLoad((0.0, 1e-3, 0.0))
    return settle(arm, T, Scene(*RODS[rod].effects, load), 1e-8)


@pytest.mark.parametrize("rod", RODS)
@pytest.mark.parametrize("case", LOADED, ids=lambda case: case["label"])
def test_loaded_rods_settle_to_an_independent_planar_rod_code(
    case: dict[str, Any], rod: str
) -> None:
    shape = settled(case, rod)
    assert np.linalg.norm(shape.tip[:2] - case["rods"][rod]["tip"]) < 1e-7
    assert abs(shape.tip[2]) < 1e-12
    turn = np.arctan2(shape.tip_frame[1, 0], shape.tip_frame[0, 0])
    assert turn == pytest.approx(case["rods"][rod]["theta"], abs=1e-6)


# Section 8 of the physics: tip error in % of L, table 2, 2 x 1 N against each other.
@pytest.mark.parametrize(
    ("rod", "known"), [("paper", 0.47), ("exact", 0.49), ("nh", 0.06), ("nha", 0.05)]
)
def test_rods_are_as_near_to_finite_elements_as_known(rod: str, known: float) -> None:
    case = next(case for case in LOADED if case["label"] == "inplane T1 F1e-3")
    gap = np.linalg.norm(settled(case, rod).tip[:2] - case["tip"]) / 0.31
    assert 100 * gap == pytest.approx(known, abs=0.005)


ARM, ROD = Arm.from_paper("table-2"), paper_rod("table-2")
PULLS = np.array([[1, np.sqrt(3), 0, 0], [0, 0, 0.5, 0], [0, 0, 0, 1.0]])
TIP_FORCE, POINT, AT = np.array([3e-3, 2e-3, -4e-3]), np.array([0, 5e-3, 5e-3]), 0.12

ROWS = ((0.31, 7.5e-3, 1e-3), (0.217, 3.5e-3, 3.5e-3), (0.093, 6e-3, 6e-3))


@pytest.mark.parametrize("extension", [True, False], ids=["extension", "bending"])
def test_a_load_across_a_bent_arm_twists_it(extension: bool) -> None:
    loads = (TipLoad(tuple(TIP_FORCE)), PointLoad(AT, tuple(POINT)))
    shape = settle(ARM, PULLS, Scene(*loads, *([Extension()] if extension else [])), 1e-11)
    for s in (0.0, 0.05, 0.093, 0.11, 0.15, 0.217, 0.25, 0.3, 0.31):
        u, frame = shape.position(s), shape.frame(s)
        moment = np.cross(shape.tip - u, TIP_FORCE)
        if s <= AT:
            moment = moment + np.cross(shape.position(AT) - u, POINT)
        D, m = balance(ROD, np.ravel(PULLS), s, ROD.active(s))
        omega = np.linalg.solve(D, m + frame.T @ moment)
        assert np.allclose(shape.strain(s)[:3], omega, rtol=0, atol=1e-8)
    assert abs(shape.strain(0.15)[0]) > 0.1


def test_with_the_papers_tangent_sections_slide_by_the_force_across() -> None:
    shape = settle(ARM, PULLS, Scene(Extension(), Shear(0.9), TipLoad(tuple(TIP_FORCE))), 1e-11)
    low, high = 0.093, 0.217
    x = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (np.arange(24) + 0.5) / 24)
    course = [Chebyshev.fit(x, u, 23, (low, high)).deriv() for u in shape.position(x).T]
    for s in (0.1, 0.15, 0.2):
        nu = shape.frame(s).T @ [slope(s) for slope in course]
        R = 15e-3 + (6.5e-3 - 15e-3) * s / 0.31
        force = shape.frame(s).T @ TIP_FORCE
        for (at, a, b), pulls in zip(ROWS[:2], PULLS, strict=False):
            y, slope = a + (b - a) * s / at, (b - a) / at
            for phi, T in zip(np.arange(4) * np.pi / 2, pulls, strict=True):
                d = np.array([0, np.cos(phi), np.sin(phi)])
                force -= T * ([1, 0, 0] + slope * d + y * np.cross(shape.strain(s)[:3], d))
        EA = 110e3 * np.pi * R**2
        wanted = [1 + force[0] / EA, *(3 * force[1:] / (0.9 * EA))]
        assert np.allclose(nu, wanted, rtol=0, atol=1e-9)
