"""Plans that keep clear of obstacles, of the far side of the base plane and of the arm itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.extensions.clearance import Clearance
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.rotations import matrices
from octoplan.model.shape import Shape
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.extensions.avoidance.around import line_of
from octoplan.planner.extensions.avoidance.rows import avoiding, cubic, element_of, grid
from octoplan.planner.frontends.io.scene_file import read
from octoplan.planner.limits import TendonLimits
from octoplan.planner.outcome import verdict
from octoplan.planner.planning_problem import Environment, NlpOptions, PlanningProblem
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.core.planner.cases import changed
from tests.oracles import Array

ARM, SCENE = Arm.from_paper("table-4"), Scene(Extension())
TARGET = TipPosition((0.3, 0.12, -0.12))


def _gap(shape: Shape, obstacle: Obstacle) -> float:
    """Return the distance of the arm's surface at very many places."""
    s = np.linspace(0.0, ARM.length, 4001)
    R = ARM.radius.evaluate(s, ARM.length)[0]
    return float((obstacle.distance(shape.position(s)) - R).min())


@pytest.fixture(scope="module")
def free() -> Plan:
    return plan(ARM, TARGET, SCENE, 20.0)


@pytest.fixture(scope="module")
def around(free: Plan) -> Plan:
    ball = Sphere(free.shape.position(0.6 * ARM.length), 0.02)
    return plan(ARM, TARGET, SCENE, 20.0, obstacles=[ball], clearance=0.003)


def _check(free: Plan, p: Plan) -> None:
    (obstacle,) = p.problem.environment.obstacles
    assert _gap(free.shape, obstacle) < 0
    assert p.certificate.passed, p.outcome
    assert (
        p.problem.environment.clearance <= p.certificate.clearance <= _gap(p.shape, obstacle) + 1e-9
    )
    assert p.effort > free.effort
    # The plan keeps no more than the required clearance.
    assert _gap(p.shape, obstacle) < p.problem.environment.clearance + 1e-3


def test_a_plan_leads_around_a_ball(free: Plan, around: Plan) -> None:
    _check(free, around)


@pytest.mark.quick("<lambda>1")
@pytest.mark.parametrize(
    "make",
    [
        lambda at: Capsule(at + np.array([0, -0.1, 0]), at + np.array([0, 0.1, 0]), 0.012),
        lambda at: Box(at + np.array([0, 0, 0.03]), (0.04, 0.04, 0.06)),
    ],
)
def test_a_plan_leads_around_other_bodies(free: Plan, make: Callable[[Array], Obstacle]) -> None:
    obstacle = make(free.shape.position(0.6 * ARM.length))
    _check(free, plan(ARM, TARGET, SCENE, 20.0, obstacles=[obstacle]))


def test_an_obstacle_out_of_the_way_changes_nothing(free: Plan) -> None:
    p = plan(ARM, TARGET, SCENE, 20.0, obstacles=[Sphere((0.0, -0.4, 0.0), 0.05)])
    np.testing.assert_array_equal(p.tensions, free.tensions)
    assert p.solution.avoidance is None


def test_a_plan_around_is_followed_by_its_own_inequalities(free: Plan, around: Plan) -> None:
    target = TipPosition((0.3, 0.121, -0.119))
    asked = {"obstacles": around.problem.environment.obstacles, "clearance": 0.003}
    p = plan(ARM, target, SCENE, 20.0, near=around, **asked)
    _check(free, p)
    assert p.solution.avoidance == around.solution.avoidance
    # The target was in a plane of symmetry, beside which one of the two images costs less.
    assert np.abs(p.tensions - around.tensions).max() < 0.05 * around.tensions.max()
    searched = plan(ARM, target, SCENE, 20.0, **asked)
    assert searched.effort * (1 - 1e-3) <= p.effort <= searched.effort * 1.05


@pytest.mark.slow
@pytest.mark.parametrize("scene", [Scene.silicone(), Scene(Extension(), Weight(), Buoyancy())])
def test_a_plan_in_other_scenes_leads_around(scene: Scene) -> None:
    before = plan(ARM, TARGET, scene, 20.0)
    obstacle = Sphere(before.shape.position(0.6 * ARM.length), 0.02)
    p = plan(ARM, TARGET, scene, 20.0, obstacles=[obstacle])
    assert p.certificate.passed, p.outcome
    assert _gap(p.shape, obstacle) >= 0


@pytest.mark.slow
def test_where_nothing_leads_around_the_nearest_shape_keeps_clear() -> None:
    plate = Box((0.2, 0.0, 0.0), (0.02, 3.0, 3.0))
    p = plan(ARM, TARGET, SCENE, 20.0, obstacles=[plate], starts=2)
    assert not p.certificate.passed
    assert p.mode == "nearest"
    assert p.outcome.startswith("Not reached: the nearest shape found is off")
    assert "not reached clear of the obstacles" in p.outcome
    assert "what the arm is to keep clear of" in p.holding()
    assert p.certificate.gaps["obstacles"] >= 0


def test_a_plan_among_obstacles_is_found_from_sampled_shapes() -> None:
    """The ball was reported as obstructing; known tensions pass 72 mm beside the ball."""
    arm = Arm(
        0.633,
        Linear(0.015, 0.0069),
        (
            Anchorage(0.633, Linear(0.0051, 0.0028), (1.44, 2.92, 4.58, 5.56, 6.67)),
            Anchorage(0.3, Linear(0.0126, 0.0093), (3.49, 3.64, 4.21)),
        ),
        Material(385e3, 0.3, 1235.0),
        base_frame=(
            (0.8283309030950025, -0.557288193825191, -0.057426335429605846),
            (-0.5228531186960308, -0.7321652791342214, -0.4365302054842726),
            (0.201227560854997, 0.3916169979116884, -0.8978549970340336),
        ),
    )
    scene = Scene(Extension(), ExactTendons())
    known = settle(arm, np.array([0.5, 0, 0, 0, 0, 10.7, 10.6, 0.0]), scene)
    ball = Sphere((0.19, 0.055, 0.048), 0.041)
    target = TipPosition(tuple(known.tip.tolist()))
    p = plan(arm, target, scene, 11.0, obstacles=[ball], clearance=1e-3)
    assert p.reached, p.outcome
    shape = settle(arm, p.tensions, scene)
    s = np.linspace(0.0, arm.length, 2001)
    radius = arm.radius.evaluate(s, arm.length)[0]
    assert (ball.distance(shape.position(s)) - radius).min() >= 1e-3 - 1e-9
    assert np.linalg.norm(shape.tip - known.tip) < 1e-6 * arm.length


@pytest.mark.slow
def test_where_no_shape_keeps_clear_the_outcome_says_what_is_touched() -> None:
    bend, wall = BendingPlane(angle=0.0, bend=0.02), HalfSpace((0.3, 0, 0), (-1.0, 0, 0))
    p = plan(ARM, bend, SCENE, 0.01, obstacles=[wall], starts=1)
    assert not p.certificate.passed
    assert p.outcome.startswith("Not clear: it passes through obstacles[0] by 15")


@pytest.mark.slow
def test_an_obstacle_that_guesses_do_not_come_near_is_led_around_without_loads() -> None:
    """Poses became unknowns for a ball nearby: the plan ended in a ValueError."""
    ball = Sphere((0.157, -0.071, -0.08), 0.02)
    p = plan(ARM, TipPosition((0.162, -0.049, -0.056)), Scene(), 20.0, obstacles=[ball])
    assert p.certificate.passed, p.outcome
    assert _gap(p.shape, ball) >= 0


def test_the_outcome_tells_what_was_to_be_kept_clear_of() -> None:
    """The outcome named the far side of the base plane, which was nearer, but not requested."""
    p = plan(ARM, TARGET, SCENE, 20.0, starts=1)
    ball = Clearance(-0.002, "obstacles[0]", (0.2,))
    nearer = {"obstacles": ball, "itself": Clearance(-0.05, "itself", (0.1, 0.4))}
    vars(p)["certificate"] = replace(
        p.certificate,
        gaps_asked={"obstacles": ball.gap},
        least_gaps={"obstacles": 0.0},
        clearances=nearer,
    )
    assert verdict(p).startswith(f"Not clear: {ball};")


BEHIND = np.zeros((3, 4))
BEHIND[2, 2], BEHIND[1, 2] = 14.0, 5.0


@pytest.mark.quick("False")
@pytest.mark.parametrize("avoided", [False, True])
def test_behind_the_base_is_told_and_avoided_on_request(avoided: bool) -> None:
    target = TipPosition(settle(ARM, BEHIND, SCENE).tip)
    assert target.position[0] < 0
    p = plan(ARM, target, SCENE, 20.0, starts=1, self_clearance=avoided)
    assert p.certificate.passed != avoided
    if avoided:
        assert p.certificate.clearance >= 0
        assert not p.certificate.warnings
    else:
        assert "Beware: the arm passes through the far side of its base plane" in p.outcome


def test_places_are_read_off_the_stations_of_the_settled_arm() -> None:
    """The mesh has other nodes; the nearest nodes were used instead, up to 3 mm away."""
    T = np.zeros(12)
    T[10], T[6] = 14.0, 5.0
    question = (ARM, (TARGET,), SCENE, TendonLimits.of(ARM, 20.0), NlpOptions(), 1e-6)
    line, shape = line_of(PlanningProblem(*question), T), settle(ARM, T, SCENE, 1e-8)
    assert line is not None
    avoidance, _ = avoiding(line, Environment(of_itself=True), None)
    assert avoidance.rows
    for place in (row.place for row in avoidance.rows):
        k = element_of(ARM, place.s)
        poses = shape.poses(grid(ARM)[k : k + 2])
        ends = np.stack([poses[:, 4:], matrices(poses[:, :4])[:, :, 0]], axis=1).reshape(-1, 3)
        read = cubic(ARM, place.s, place.length) @ ends + place.shift
        np.testing.assert_allclose(read, shape.position(place.s), atol=1e-6)


def test_an_arm_that_passes_through_itself_says_so(free: Plan) -> None:
    T = np.array(free.tensions)
    T[0, 0] = 3.0
    coiled = changed(free, tensions=T)
    assert coiled.certificate.gaps["itself"] < 0
    assert "the arm passes through itself" in coiled.outcome
    assert "beware" in str(coiled.certificate)


def test_a_plan_with_obstacles_loads_back_equal(around: Plan, tmp_path: Path) -> None:
    other = load_plan(around.save(tmp_path / "plan.json"))
    assert other == around
    assert other.certificate.passed
    assert other.certificate.clearance == around.certificate.clearance


@pytest.mark.slow
def test_a_plan_near_another_is_led_around_under_loads_too() -> None:
    """The call ended in an error of CasADi."""
    scene = Scene(Extension(), Weight(), Buoyancy())
    ball = Sphere(
        plan(ARM, TARGET, scene, 20.0, starts=1).shape.position(0.6 * ARM.length),
        0.02,
    )
    given = {"obstacles": [ball], "clearance": 0.003}
    first = plan(ARM, TARGET, scene, 20.0, starts=1, **given)
    found = plan(ARM, TipPosition((0.29, 0.12, -0.12)), scene, 20.0, near=first, **given)
    assert found.certificate.passed, found.outcome
    assert found.certificate.clearance >= 0.003


def test_figures_show_obstacles_and_the_nearest_place(around: Plan) -> None:
    labels = around.plot().axes[0].get_legend_handles_labels()[1]
    assert any("mm clear" in label for label in labels)


@pytest.mark.slow
def test_a_thousand_obstacles_work() -> None:
    rng = np.random.default_rng(0)
    many = [Sphere(x, 0.004) for x in rng.uniform((0.02, -0.4, -0.4), 0.4, (1000, 3))]
    many = [o for o in many if np.linalg.norm(np.array(o.center) - TARGET.position) > 0.02]
    p = plan(ARM, TARGET, SCENE, 20.0, obstacles=many)
    assert p.certificate.gaps["obstacles"] >= 0
    assert p.certificate.passed or p.outcome.startswith("Not reached")


FILE = b"""
clearance_mm = 2
self_clearance = true
[arm]
preset = "table-4"
[target]
type = "tip-position"
position_mm = [300, 120, -120]
[limits]
tension_max = 20
[[obstacles]]
type = "sphere"
center_mm = [150, 0, 50]
radius_mm = 20
[[obstacles]]
type = "capsule"
start_mm = [150, 100, 50]
end_mm = [150, 200, 50]
radius_mm = 20
[[obstacles]]
type = "box"
center_mm = [150, -100, 50]
size_mm = [10, 20, 30]
[[obstacles]]
type = "half-space"
point_mm = [0, 0, -300]
normal = [0, 0, 1]
"""


def test_scene_files_hold_obstacles() -> None:
    options = read(FILE).options
    kinds = [type(obstacle).__name__ for obstacle in options["obstacles"]]
    assert kinds == ["Sphere", "Capsule", "Box", "HalfSpace"]
    assert options["obstacles"][2] == Box((0.15, -0.1, 0.05), (0.01, 0.02, 0.03))
    assert options["clearance"] == pytest.approx(0.002)
    assert options["self_clearance"] is True
