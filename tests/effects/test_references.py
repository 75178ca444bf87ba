"""Exact tendons and the neo-Hookean body against independent programs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import ExactTendons
from tests.effects.cases import DATA, EXACT, RODS, fem_arm, fem_cases, name_of

PAPER_CASES = json.loads((DATA / "reference_cases.json").read_text())["cases"]


@pytest.mark.parametrize("scheme", ["magnus6", "gauss6"])
@pytest.mark.parametrize("case", PAPER_CASES, ids=lambda case: case["name"])
def test_exact_tendons_settle_to_the_references(case: dict[str, Any], scheme: str) -> None:
    arm = Arm.from_paper(case["arm"])
    for name, scene in (("exact", EXACT), ("exact_no_extension", Scene(ExactTendons()))):
        tip = settle(arm, case["tensions"], scene, 1e-8, scheme).tip
        assert np.linalg.norm(tip - case["tip"][name]) < 1e-8


@pytest.mark.parametrize("rod", RODS)
@pytest.mark.parametrize("case", fem_cases(), ids=name_of)
def test_rods_settle_to_an_independent_planar_rod_code(case: dict[str, Any], rod: str) -> None:
    arm, T = fem_arm(case)
    shape = settle(arm, T, RODS[rod], 1e-8)
    assert np.linalg.norm(shape.tip[:2] - case["rods"][rod]["tip"]) < 1e-6
    assert abs(shape.tip[2]) < 1e-12
    turn = np.arctan2(shape.tip_frame[1, 0], shape.tip_frame[0, 0])
    gap = (turn - case["rods"][rod]["theta"] + np.pi) % (2 * np.pi) - np.pi
    assert abs(gap) < 1e-4


# Section 8 of the physics: tip error in % of L against finite elements, exact + neo-Hookean.
@pytest.mark.parametrize(
    ("name", "allowed", "with_shift"),
    [
        ("a 0.05", 0.10, 0.02),
        ("a 0.1", 0.24, 0.10),
        ("b 0.53", 0.04, 0.09),
        ("b 2", 0.43, 0.14),
        ("c 0.5", 0.10, 0.10),
        ("d inplane T1 F0", 0.06, 0.06),
    ],
)
def test_silicone_is_as_near_to_finite_elements_as_known(
    name: str, allowed: float, with_shift: float
) -> None:
    case = next(case for case in fem_cases() if name_of(case) == name)
    arm, T = fem_arm(case)
    gaps = {
        rod: 100 * np.linalg.norm(settle(arm, T, RODS[rod]).tip[:2] - case["tip"]) / arm.length
        for rod in ("exact", "nh", "nha")
    }
    assert gaps["nh"] < allowed
    assert gaps["nha"] < with_shift
    assert gaps["exact"] > 2 * gaps["nh"] or gaps["nh"] < 0.06
