"""Plans are optima: of an independent program, mirrored, and in cases that once failed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from octoplan.model import Arm, Scene, settle
from octoplan.model.arm import conical
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, TipLoad, Weight
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.solution import NlpSolution
from octoplan.planner.solve import multistart
from octoplan.planner.solve.refine import refine
from octoplan.planner.targets import Backbone, Bend, Fetch, TipPose, TipPosition
from tests.core.planner.cases import PAPER, Array, off, read

ARM = Arm.from_paper("table-4")
MOST = 20.0
SLSQP_SCENES = {
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "follower": Scene(Extension(), TipLoad((0.0, 0.002, 0.0), follower=True)),
}
ORDER = {"2": 2, "1": 1, "inf": np.inf}


def least(scene: Scene, tip: Array, start: Array, norm: str) -> Array:
    """Tensions of least effort near a start, by SLSQP on tensions alone (and the largest)."""

    def effort(z: Array) -> float:
        return {"2": float(z[:12] @ z[:12]) / 2, "1": float(z[:12].sum()), "inf": float(z[12])}[
            norm
        ]

    rows = [
        {
            "type": "eq",
            "fun": lambda z: (settle(ARM, np.clip(z[:12], 0, MOST), scene, 1e-9).tip - tip) / 0.45,
        },
        {"type": "ineq", "fun": lambda z: z[12] - z[:12]},
    ]
    z = minimize(
        effort,
        np.append(start, start.max()),
        bounds=[(0, MOST)] * 13,
        constraints=rows,
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
    ).x
    assert np.linalg.norm(settle(ARM, z[:12], scene, 1e-9).tip - tip) < 1e-6
    return np.asarray(z[:12])


@pytest.mark.quick("paper-2")
@pytest.mark.parametrize("norm", ["2", "1", "inf"])
@pytest.mark.parametrize("name", SLSQP_SCENES)
def test_no_tensions_near_a_plan_meet_its_tip_with_less_effort(
    name: str, norm: str, deviation: Callable[..., float]
) -> None:
    scene, rng = SLSQP_SCENES[name], np.random.default_rng(7)
    T = np.array([0, 0.1, 0, 0, 0.4, 0, 0, 0.2, 0, 1.1, 0.3, 0])
    tip = settle(ARM, T, scene, 1e-9).tip
    found = plan(ARM, TipPosition(tuple(tip)), scene, MOST, norm=norm)
    assert found.certificate.passed, found.outcome
    start = np.ravel(found.tensions) + 0.02 * rng.uniform(size=12)
    other = least(scene, tip, np.clip(start, 0, MOST), norm)
    least_effort = float(np.linalg.norm(other, ORDER[norm]))
    assert found.effort <= least_effort * (1 + 1e-5)
    assert deviation(found.effort, least_effort, least_effort) < 2e-3


@pytest.mark.slow
def test_a_target_in_a_plane_that_is_cheaper_out_of_it_has_a_mirror_image() -> None:
    T = np.zeros((3, 4))
    rng = np.random.default_rng(3)
    pulls = rng.exponential(1, (3, 2)) * np.array([[0.2], [1.0], [3.0]])
    T[:, [0, 1]] = T[:, [2, 3]] = 0
    pulls *= rng.random((3, 2)) < 0.6
    T[:, [0, 1]], T[:, [2, 3]] = pulls[:, :1], pulls[:, 1:]
    target = TipPosition(tuple(settle(ARM, T, PAPER, 1e-10).tip))
    p = plan(ARM, target, PAPER, 20.0)
    assert p.reached
    ((angle, other),) = p.mirror_images()
    assert np.isclose(np.degrees(angle), 45)
    assert "mirror image across the plane at 45 deg" in p.outcome
    assert np.isclose(np.linalg.norm(other), p.effort)
    tip = settle(ARM, other, PAPER, 1e-9).tip
    assert np.linalg.norm(tip - target.position) < 1e-6 * ARM.length
    unequal = np.full((3, 4), 20.0)
    unequal[1, 0] = 5.0
    assert not plan(ARM, target, PAPER, unequal).mirror_images()


@pytest.mark.quick("2")
@pytest.mark.parametrize("seed", range(4))
def test_targets_in_a_plane_get_plans_in_it(seed: int) -> None:
    rng, T = np.random.default_rng(seed), np.zeros((3, 4))
    T[:, [0, 2]] = rng.exponential(1, (3, 2)) * np.array([[0.2], [1.0], [3.0]])
    p = plan(ARM, TipPosition(tuple(settle(ARM, T, PAPER).tip)), PAPER, 20.0)
    assert np.allclose(p.tensions[:, 1], p.tensions[:, 3], atol=1e-6)
    assert not p.mirror_images()
    assert "mirror" not in p.outcome


def test_an_arm_at_rest_has_no_mirror_image() -> None:
    """Tensions of 5e-12 N, rounding, were mirrored."""
    rest = plan(ARM, TipPosition((ARM.length, 0.0, 0.0)), PAPER, 20.0, norm="inf")
    assert rest.reached
    assert not rest.mirror_images()


@pytest.mark.quick("load1")
@pytest.mark.parametrize("load", [Weight(), TipLoad((0.0, 0.0, 2e-3), (0.0, 0.0, 0.0))])
def test_loads_across_the_plane_have_no_mirror_image(load: object) -> None:
    scene, T = Scene(Extension(), load), np.zeros((3, 4))
    T[2, [0, 1]] = 1.0
    p = plan(
        ARM,
        TipPosition(tuple(settle(ARM, T, scene).tip)),
        scene,
        20.0,
        starts=2,
    )
    assert p.reached
    assert not p.mirror_images()


EXACT = Scene(Extension(), ExactTendons())
PAYLOAD = Scene(Extension(), TipLoad((0.0, 0.0, -0.002)))


def arm_tensions(*rows: list[float]) -> Array:
    return np.array(rows)


def planned(kind: str, scene: Scene, T: Array, starts: int | None = None) -> Plan:
    """Plan for the target that a set of tensions reaches, and check that the target is met."""
    target = read(kind, settle(ARM, T, scene, 1e-10), 1 + int(np.argmax(T.sum(axis=1))))
    found = plan(ARM, target, scene, 20.0, starts=starts)
    assert found.reached, found.outcome
    assert off(settle(ARM, found.tensions, scene, 1e-9), target, kind) < 1e-6
    return found


# The tensions of the target, and the effort that earlier versions needed or exceeded.
LOST: dict[str, tuple[str, Scene, Array, float]] = {
    # 35 % more effort than the tensions of the target.
    "a fetch out of any plane": (
        "fetch",
        PAPER,
        arm_tensions([0, 0, 0, 0.134953], [0, 0, 0, 0.605446], [6.72757, 0, 0, 0]),
        6.7628,
    ),
    # 50 % more than the least known effort.
    "co-contraction let go": (
        "fetch",
        PAPER,
        arm_tensions(
            [0.10302, 0.22289, 0.182723, 0.244538],
            [1.608577, 0.34945, 1.503274, 1.983433],
            [3.972502, 7.645601, 9.260448, 4.846649],
        ),
        2.66,
    ),
    # The optimum was lost on the finer mesh, and the target was reported as out of reach.
    "a pose of a sharply bent arm": (
        "pose",
        EXACT,
        arm_tensions([0, 0, 0.1766204345, 0], [0, 0, 0, 0.9142803276], [1.8718567706, 0, 0, 0]),
        1.25,
    ),
    # 43 % more effort than the tensions of the target.
    "a pose by the long way round": (
        "pose",
        Scene(),
        arm_tensions([0, 0, 0.17660976, 0], [0, 0.39592593, 0, 0], [1.07905678, 0, 0, 0]),
        1.16288,
    ),
    # 2.2 times the effort: in guesses the tip's tendons counted 70 times as much as the base's.
    "a pose in silicone": (
        "pose",
        Scene.silicone(),
        arm_tensions([0, 0, 0.50372093, 0], [0, 3.82099489, 0, 0], [0, 0, 1.59973819, 0]),
        4.1729,
    ),
    # Reported as out of reach after 12 guesses, by 22 mm.
    "a pose of a strongly pulled arm": (
        "pose",
        EXACT,
        arm_tensions(
            [0, 0.27771174, 0.10437704, 0.38910404],
            [0.35893687, 0.4531971, 0, 1.54591028],
            [0.60319203, 6.1737029, 11.85577569, 2.2458995],
        ),
        13.6764,
    ),
    # Guesses by bends alone, which meet the target less directly, need 44 % more effort.
    "a pose by co-contraction": (
        "pose",
        PAPER,
        arm_tensions([0, 0.3708, 0.1953, 0], [0, 3.1068, 0, 1.0717], [0, 0, 6.7821, 0.8305]),
        5.58,
    ),
    # 12 % more: the tip section has thirty times the tension that bends the arm by 1 rad.
    "a tip that winds up": (
        "fetch",
        PAPER,
        arm_tensions([0, 0, 0, 0.284], [0, 0, 0, 2.661], [2.331, 0, 0, 0]),
        3.2,
    ),
    # Reported as out of reach by 47 degrees: tensions far above the bending tension.
    "a tip against its weight": (
        "plane",
        Scene(Extension(), Weight(), Buoyancy(1000.0)),
        arm_tensions([0, 0, 0.4565, 0.2226], [0, 0, 0, 0], [0, 0, 0, 0]),
        0.50838,
    ),
    # Missed the points by 1.3 mm, close to the error of the coarse mesh.
    "a backbone that starts come near": (
        "backbone",
        PAPER,
        arm_tensions(
            [0.456991, 0.186692, 0, 0.280545], [3.79518, 0.887131, 0, 0], [0, 0, 12.9943, 0]
        ),
        np.inf,
    ),
    # Tendons that need not pull pulled by 1e-5 N or by 0.4 N, and points were missed by 1e-6 L.
    "a backbone with extension": (
        "backbone",
        PAPER,
        arm_tensions([0, 0, 0.219435, 0], [0, 0, 0, 2.70805], [0, 0, 1.046276, 0]),
        2.9117,
    ),
    # Guesses that are cheapest without loads lead nowhere.
    "a pose in water": (
        "pose",
        Scene(Extension(), Weight(), Buoyancy(1000.0)),
        arm_tensions(
            [0.04098835, 0.20327758, 0.12548955, 0.18633734],
            [1.33586882, 0.02408027, 0.74042602, 0.48316566],
            [3.79397274, 3.53371947, 4.13256482, 4.33029231],
        ),
        1.6,
    ),
    "a backbone, bare": (
        "backbone",
        Scene(),
        arm_tensions([0, 0.121853, 0, 0], [0, 0, 0, 1.22828], [0, 4.647643, 0, 0]),
        4.8092,
    ),
    # The mesh was fine enough for the tip's position, but not for its rotation.
    "turn": (
        "pose",
        EXACT,
        arm_tensions([0, 0, 0, 0.19237465], [0.64343539, 0, 0, 0], [0, 0.42067256, 0, 0]),
        0.79245,
    ),
    # The best optimum of a mesh too coarse was none.
    "spurious": (
        "fetch",
        EXACT,
        arm_tensions(
            [0.08672236, 0.1153586, 0.33877957, 0.25888182],
            [0.52291279, 2.87276665, 1.57920865, 0.61091369],
            [2.09169601, 9.15593887, 7.11253338, 4.76061170],
        ),
        13.1549,
    ),
    "spurious, loaded": (
        "fetch",
        PAYLOAD,
        arm_tensions(
            [0.20990269, 0.11965186, 0.04501516, 0.24367698],
            [2.27604576, 0.24897468, 1.16035894, 1.92024336],
            [1.81469894, 1.48982744, 6.29352436, 3.27859854],
        ),
        8.1404,
    ),
    # Sections near the base settle the robust way only.
    "robust": (
        "backbone",
        EXACT,
        arm_tensions(
            [0.24576321, 0.10581591, 0.32965768, 0.03850503],
            [2.86485760, 2.60620905, 2.38533694, 1.23772814],
            [3.28191182, 4.06706750, 5.00498247, 7.66492395],
        ),
        11.5549,
    ),
}


SLOW = {
    "a pose of a strongly pulled arm",
    "a tip against its weight",
    "a pose by co-contraction",
    "a tip that winds up",
    "a backbone, bare",
    "turn",
    "spurious",
    "spurious, loaded",
    "robust",
}


@pytest.mark.quick("a pose of a sharply bent arm")
@pytest.mark.parametrize(("kind", "scene", "T", "most"), LOST.values(), ids=LOST)
def test_what_was_lost_or_cost_more_is_met(kind: str, scene: Scene, T: Array, most: float) -> None:
    found = planned(kind, scene, T)
    assert found.effort <= most
    assert found.certificate.soft_residual.get("distance to the points", 0.0) < 1e-7


def test_a_cheaper_optimum_that_is_lost_on_finer_meshes_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The optimum was dropped without a report, and the next one certified."""
    rng = np.random.default_rng(1)
    T = rng.exponential(1, (3, 4)) * np.array([[0.2], [1.0], [3.0]])
    T = T * (np.random.default_rng(1).random((3, 4)) < 0.4)
    target = TipPosition(tuple(settle(ARM, T, PAPER).tip))
    best = plan(ARM, target, PAPER, 20.0)

    def losing(coarse: NlpSolution) -> NlpSolution | None:
        same = abs(coarse.f / min(s.objective for s in best.solution.starts) - 1) < 1e-3
        return None if same else refine(coarse)

    monkeypatch.setattr(multistart, "refine", losing)
    found = plan(ARM, target, PAPER, 20.0, starts=8)
    assert found.reached
    assert found.solution.lost == pytest.approx(1 - best.effort / found.effort, rel=0.02)
    assert "cheaper on the coarse mesh was lost" in found.outcome
    assert "lost" not in best.outcome
    found.save(tmp_path / "plan.json")
    assert load_plan(tmp_path / "plan.json") == found


@pytest.mark.slow
@pytest.mark.xfail(reason="none of 60 initial guesses leads there: 1.82 N", strict=True)
def test_where_the_coarse_mesh_misleads_the_search_goes_on_on_a_finer_one() -> None:
    """An optimum of 1.91 N was the answer, though 30 initial guesses were asked for."""
    rng = np.random.default_rng(57)
    T = rng.exponential(1, (3, 4)) * np.array([[0.2], [1.0], [3.0]])
    T *= np.random.default_rng(57).random((3, 4)) < 0.4
    scene = Scene(Extension(), ExactTendons())
    assert planned("pose", scene, T, starts=30).effort < 1.7


@pytest.mark.slow
def test_where_all_coarse_optima_topple_the_search_goes_on_on_a_finer_mesh() -> None:
    """The plan was not certified, although the tensions hold the arm."""
    T = [[0, 0.36646651, 0.28857915, 0.11693461], [0, 0.05693408, 7.22609678, 0]]
    T.append([0, 0, 6.91155253, 0.23774178])
    scene = Scene.silicone(Weight())
    found = plan(ARM, TipPosition(tuple(settle(ARM, T, scene).tip)), scene, 20.0)
    assert found.reached
    assert found.effort < 3.1


# Least squares of the gradient leave a larger residual than the multipliers of the last solve if
# constraints are nearly dependent.
def test_a_fetch_in_one_plane_is_certified() -> None:
    distal = Bend(1.7576968621113056, -1.5707963267948968)
    medial = Bend(0.27082949623417213, -1.5707963267948966)
    target = Fetch(Bend(0.11604413653858578, -0.3606366228609522), medial, distal)
    assert plan(ARM, target, Scene(), MOST).certificate.passed


@pytest.mark.slow
def test_a_backbone_is_met_to_fine_accuracy_or_told_not_to_be_resolved() -> None:
    scene = Scene(Extension())
    drawn = settle(ARM, [[0, 0.12, 0, 0], [0, 0, 0, 1.2], [0, 4.6, 0, 0]], scene, 1e-10)
    s = np.linspace(0, ARM.length, 9)[1:]
    points = Backbone(drawn.position(s), s)
    off = {}
    for accuracy in (1e-6, 1e-9):
        found = plan(ARM, points, scene, MOST, accuracy=accuracy)
        (off[accuracy],) = found.certificate.soft_residual.values()
        assert found.reached
        met = off[accuracy] <= accuracy
        assert found.outcome.startswith("Reached: every target met") == met
        assert "it may be met all the same" in found.outcome or met
        assert "no limit is active" not in found.outcome
    assert off[1e-9] < off[1e-6]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_poses_of_an_arm_with_many_sections_take_no_more_than_the_tensions_drawn(seed: int) -> None:
    """Independent guesses of all bends missed the target, or needed ten times the effort."""
    ends = np.linspace(0.45, 0.0, 24, endpoint=False)
    sections = [(at, 7.5e-3, (15e-3 - 13e-3 * at / 0.45) / 2) for at in ends.tolist()]
    arm, rng = conical(0.45, (15e-3, 2e-3), sections), np.random.default_rng(seed)
    T = rng.uniform(size=(24, 4)) * np.geomspace(0.01, 0.5, 24)[:, None]
    T *= rng.uniform(size=(24, 4)) < 0.1
    shape = settle(arm, T, Scene())
    frame = tuple(tuple(row) for row in shape.tip_frame.tolist())
    p = plan(arm, TipPose(tuple(shape.tip.tolist()), frame), Scene(), MOST)
    assert p.reached, p.outcome
    assert p.effort <= np.linalg.norm(T)
