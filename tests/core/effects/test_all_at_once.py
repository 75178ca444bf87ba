"""All loads together: against shooting in SciPy, references and other stages; of nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from tests.collocation import collocated
from tests.core.effects.cases import RODS, Array, fem_arm, fem_cases, name_of
from tests.core.effects.spatial import LoadedRod, Loads
from tests.oracles import paper_rod

FORCE, MOMENT = (1e-3, -2e-3, 1e-3), (1e-5, 2e-5, 0.0)
POINTS = ((0.12, (0.0, 3e-3, 1e-3)), (0.2, (0.0, 4e-3, 0.0)))
G, STREAM = (0.5, 0.3, -9.81), (0.1, 0.05, 0.1)
SPREAD = (Weight(G), Buoyancy(1000.0), Current(STREAM))
AT_POINTS = tuple(PointLoad(s, force) for s, force in POINTS)
PULLS = [[0, 0.2, 0.1, 0], [1.0, 0, 0, 0], [0, 3.0, 0, 0]]


def tip(follower: bool) -> TipLoad:
    return TipLoad(FORCE, MOMENT, follower)


@pytest.mark.quick("follower, extension, shear")
@pytest.mark.parametrize(
    ("kinds", "follower"),
    [
        pytest.param((Extension(), Shear(0.9)), True, id="follower, extension, shear"),
        pytest.param((Extension(),), False, id="dead, extension"),
        pytest.param((Shear(0.9),), False, id="dead, shear", marks=pytest.mark.slow),
        pytest.param((), True, id="follower", marks=pytest.mark.slow),
    ],
)
def test_all_loads_on_the_papers_arm_agree_with_shooting_in_scipy(
    kinds: tuple[Effect, ...], follower: bool
) -> None:
    compare("table-2", kinds, follower, 1e-9, 3e-9)


@pytest.mark.slow
@pytest.mark.parametrize("follower", [False, True], ids=["dead", "follower"])
@pytest.mark.parametrize("kinds", [(Extension(), Shear(0.9)), (Extension(),)], ids=len)
def test_so_they_do_on_the_arm_that_fetches(kinds: tuple[Effect, ...], follower: bool) -> None:
    compare("table-4", kinds, follower, 1e-8, 3e-8)


def compare(
    name: str, kinds: tuple[Effect, ...], follower: bool, accuracy: float, far: float
) -> None:
    shear = next((kind for kind in kinds if isinstance(kind, Shear)), None)
    loads = Loads(
        np.array(FORCE),
        np.array(MOMENT),
        follower,
        tuple((s, np.array(force)) for s, force in POINTS),
        (1080 - 1000) * np.array(G),
        np.array(STREAM),
    )
    k_s = shear.k_s if shear else None
    rod = LoadedRod(paper_rod(name), np.ravel(PULLS), loads, Extension() in kinds, k_s)
    arm = Arm.from_paper(name)
    places = (0.05, 0.12, 0.25, arm.length)
    u, R = rod.poses(places)
    scene = Scene(*kinds, tip(follower), *AT_POINTS, *SPREAD)
    shape = settle(arm, PULLS, scene, accuracy)
    assert np.allclose(shape.position(places), u, rtol=0, atol=far * arm.length)
    assert np.allclose(shape.frame(places), R, rtol=0, atol=10 * far)


LOADED = (tip(True), *AT_POINTS, *SPREAD)
SCENES = {
    "paper": Scene(Extension(), Shear(), *LOADED),
    "exact": Scene(Extension(), ExactTendons(), Shear(), *LOADED),
    "rubber": Scene(Extension(), ExactTendons(), NeoHookean(anticlastic=True), Shear(), *LOADED),
    "rubbing": Scene(Extension(), ExactTendons(), Shear(), *LOADED, Friction(0.2)),
}


def poses(scene: Scene, accuracy: float) -> tuple[Array, Array]:
    shape = settle(Arm.from_paper("table-2"), PULLS, scene, accuracy)
    assert shape.error <= accuracy
    return shape.tip, shape.tip_frame


@pytest.mark.parametrize(
    "name",
    [
        "exact",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("paper", "rubber", "rubbing")),
    ],
)
def test_all_accuracies_and_stages_settle_to_the_same_shape(name: str) -> None:
    scene, arm = SCENES[name], Arm.from_paper("table-2")
    best = poses(scene, 1e-11)
    tried = [(accuracy, *poses(scene, accuracy)) for accuracy in (1e-6, 1e-9)]
    for accuracy, stages, refinement in ((1e-5, 2, 24), (1e-7, 2, 64), (1e-4, 1, 96)):
        shape = collocated(arm, PULLS, scene, stages, refinement)
        tried.append((accuracy, shape.tip, shape.tip_frame))
    for accuracy, tip, frame in tried:
        assert np.linalg.norm(tip - best[0]) < accuracy * arm.length
        assert np.abs(frame - best[1]).max() < 100 * accuracy


NOTHING: dict[str, tuple[Effect, ...]] = {
    "tip load": (TipLoad(),),
    "follower": (TipLoad(follower=True),),
    "point load": (PointLoad(0.1, (0, 0, 0)), PointLoad(0.2, (0, 0, 0))),
    "weight": (Weight((0, 0, 0)),),
    "buoyancy": (Weight((0, 0, -9.81)), Buoyancy(1080.0)),
    "current": (Current((0, 0, 0)),),
    "thin stream": (Current((0, 1.0, 0), 0.0),),
    "friction": (Friction(0.0),),
    "all": (TipLoad(), Weight((0, 0, 0)), Current((0, 0, 0)), PointLoad(0.1, (0, 0, 0))),
}


@pytest.mark.quick("paper-tip load", "paper-all")
@pytest.mark.parametrize("name", NOTHING)
@pytest.mark.parametrize(
    "kinds",
    [
        pytest.param((Extension(),), id="paper"),
        pytest.param((), id="bending", marks=pytest.mark.slow),
        pytest.param((Extension(), ExactTendons()), id="exact", marks=pytest.mark.slow),
    ],
)
def test_loads_of_nothing_change_nothing(name: str, kinds: tuple[Any, ...]) -> None:
    arm = Arm.from_paper("table-2")
    free = settle(arm, PULLS, Scene(*kinds), 1e-11)
    shape = settle(arm, PULLS, Scene(*kinds, *NOTHING[name]), 1e-11)
    assert np.allclose(shape.tip, free.tip, rtol=0, atol=2e-11 * arm.length)
    assert np.allclose(shape.tip_frame, free.tip_frame, rtol=0, atol=1e-9)
    s = np.linspace(0, arm.length, 11)
    assert np.allclose(shape.strain(s), free.strain(s), rtol=0, atol=1e-7)


def test_a_section_all_but_rigid_in_shear_is_one_without_shear() -> None:
    arm, kinds = Arm.from_paper("table-2"), (Extension(), ExactTendons(), tip(False))
    free = settle(arm, PULLS, Scene(*kinds), 1e-10).tip
    stiff = settle(arm, PULLS, Scene(*kinds, Shear(1e9)), 1e-10).tip
    assert np.allclose(stiff, free, rtol=0, atol=1e-10)


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
