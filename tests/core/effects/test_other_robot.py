"""Another robot, discs on a steel backbone, against other programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, Shear, TipLoad
from tests.core.effects.cases import DATA, Array

ROBOT = json.loads((DATA / "tdcr_reference.json").read_text())
CASES = {case["id"]: case for case in ROBOT["cases"]}
LOADED = [name for name in CASES if name.endswith("load")]
# The arm points along z; tendons are placed along x and y: t = z, n = x, b = y.
FRAME = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
SCENE = (Extension(), ExactTendons(), Shear())


def robot() -> Arm:
    sides = np.array(ROBOT["tendons"]["offsets_m"])
    y = float(np.linalg.norm(sides[0]))
    angles = np.arctan2(sides[:, 1], sides[:, 0]).tolist()
    anchorages = tuple(
        Anchorage(at, Linear(y, y), tuple(some))
        for at, some in ((0.4, angles[3:]), (0.2, angles[:3]))
    )
    r, E = ROBOT["robot"]["backbone_radius_m"], ROBOT["robot"]["youngs_modulus_Pa"]
    material = Material(E, ROBOT["robot"]["poisson"])
    return Arm(0.4, Linear(r, r), anchorages, material, FRAME, hull=Linear(0.012, 0.012))


ARM = robot()


def tip_force(case: dict[str, Any]) -> tuple[TipLoad, ...]:
    assert not any(case["tip_moment_Nm_base_frame"])
    force = case["tip_force_N_base_frame"]
    return (TipLoad(tuple(force)),) if any(force) else ()


@cache
def settled(name: str) -> Shape:
    case = CASES[name]
    T = case["tensions_N"]
    return settle(ARM, [T[3:], T[:3]], Scene(*SCENE, *tip_force(case)), 1e-10)


def far(name: str) -> float:
    """Return the accuracy of the references [m]."""
    return 1e-9 if name.endswith("load") else 1e-11


def reference(name: str, field: str) -> Array:
    return np.array(CASES[name]["reference_exact"][field])


def test_the_references_are_five_without_load_and_five_with() -> None:
    assert [name.endswith("load") for name in CASES] == [False] * 5 + [True] * 5


@pytest.mark.parametrize("name", CASES)
def test_the_tip_is_where_the_other_program_has_it(
    name: str, deviation: Callable[..., float]
) -> None:
    gap = settled(name).tip - reference(name, "tip_position_m")
    assert deviation(np.linalg.norm(gap), 0.0, ARM.length) < far(name) / ARM.length


@pytest.mark.parametrize("name", CASES)
def test_the_tip_is_turned_as_the_other_program_has_it(name: str) -> None:
    ours = settled(name).tip_frame[:, [1, 2, 0]]  # columns x, y, z there
    assert np.allclose(ours, reference(name, "tip_rotation_rows"), rtol=0, atol=10 * far(name))


@pytest.mark.parametrize("name", CASES)
def test_the_discs_are_where_the_other_program_has_them(name: str) -> None:
    discs = reference(name, "disk_positions_m")
    ours = settled(name).position(np.linspace(0, 0.4, len(discs)))
    assert len(discs) == 21
    assert np.linalg.norm(ours - discs, axis=1).max() < far(name)


@pytest.mark.parametrize("name", LOADED)
def test_the_moment_at_the_base_is_that_of_the_force(name: str) -> None:
    force = np.array(CASES[name]["tip_force_N_base_frame"])
    wanted = reference(name, "base_total_moment_Nm")
    assert np.allclose(np.cross(settled(name).tip, force), wanted, rtol=0, atol=1e-9)


UPSTREAM = "exact_with_svenlilge_junction"


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if UPSTREAM in case])
def test_the_kink_of_tendons_that_go_on_past_an_anchorage_is_felt(name: str) -> None:
    # The program that the robot comes from leaves that kink out.
    other = np.array(CASES[name][UPSTREAM]["tip_position_m"])
    apart = np.linalg.norm(other - reference(name, "tip_position_m"))
    assert np.linalg.norm(settled(name).tip - other) == pytest.approx(apart, abs=1e-9)


def test_shear_is_felt_a_little_and_extension_more() -> None:
    case = CASES["c00_load"]
    T, tip = case["tensions_N"], settled("c00_load").tip
    for left_out, least in ((Shear, 1e-8), (Extension, 1e-6)):
        kept = [effect for effect in SCENE if not isinstance(effect, left_out)]
        without = settle(ARM, [T[3:], T[:3]], Scene(*kept, *tip_force(case)), 1e-9).tip
        assert least < np.linalg.norm(without - tip) < 1e-3
