"""Contact forces that balance a wrench on an object."""

import numpy as np
import pytest

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.touches import equilibrium_contacts
from octoplan.model.extensions.obstacles import Box, Capsule
from octoplan.planner import plan
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.extensions.contact.grasp import Grasp, grips_of
from octoplan.planner.extensions.contact.hold import WRENCH
from octoplan.planner.extensions.contact.plan import ContactPlan
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.extensions.contact.search import COARSE, presses_against, with_growing_wrench
from octoplan.planner.frontends.io.saved_files import load_plan
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from tests.contact.cases import bar
from tests.contact.queries import query
from tests.core.planner.cases import changed

ARM = bar(0.3, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))
FRICTION, ASIDE = 0.5, np.radians(15)


def pressed() -> tuple[np.ndarray, np.ndarray]:
    """Return the force on the arm, and the normal, at the contact with the rod under a tension."""
    [touch] = settle(ARM, [0.0, 0.6, 0.0, 0.0], SCENE, 1e-8).contacts
    return touch.force, touch.force / np.linalg.norm(touch.force)


def wrench(angle: float) -> tuple[float, ...]:
    """Return a force of that size on the rod, that far off the normal."""
    force = pressed()[0]
    c, s = np.cos(angle), np.sin(angle)
    return tuple((np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ force).tolist())


@pytest.fixture(scope="module")
def held() -> ContactPlan:
    p = plan(ARM, Hold(ROD, wrench(ASIDE), FRICTION), SCENE, 50.0, starts=1)
    assert isinstance(p, ContactPlan)
    return p


@pytest.mark.slow
def test_the_forces_on_the_object_balance_within_their_cones_by_numpy_alone(
    held: ContactPlan,
) -> None:
    assert held.reached, held.outcome
    [hold] = held.targets
    assert isinstance(hold, Hold)
    total = np.array(hold.wrench)
    for grip in held.grips:
        out = (grip.point - np.array([0.2, grip.point[1], -0.04])) / ROD.radius
        assert np.linalg.norm(out) == pytest.approx(1.0, abs=1e-9)
        assert np.allclose(np.cross(grip.normal, out), 0.0, atol=1e-12)
        assert grip.normal @ out < 0
        assert abs(grip.tangential @ out) < 1e-12
        most = FRICTION * np.linalg.norm(grip.normal)
        assert np.linalg.norm(grip.tangential) <= most * (1 + 1e-9)
        total = total + grip.normal + grip.tangential
    assert np.linalg.norm(total) < 1e-6 * np.linalg.norm(hold.wrench)
    assert held.certificate.complementarity < 1e-8


def test_what_the_arm_presses_is_what_its_own_contacts_say(held: ContactPlan) -> None:
    for grip, touch in zip(held.grips, held.shape.contacts, strict=True):
        assert np.allclose(grip.normal, -touch.force, atol=1e-9)


def test_a_hold_reads_as_other_plans_do(held: ContactPlan) -> None:
    """The grip was printed as the fields of its object."""
    assert "tensions [N]" in str(held)
    assert held.outcome.split(":")[0] in str(held)
    assert "statement=" not in repr(held) + str(held)


def test_a_hold_is_saved_and_loads_as_it_was(held: ContactPlan, tmp_path) -> None:  # type: ignore[no-untyped-def]
    again = load_plan(held.save(tmp_path / "held.json"))
    assert again == held
    assert isinstance(again, ContactPlan)
    assert again.solution.load_path == held.solution.load_path
    assert again.reached


@pytest.mark.slow
def test_what_cannot_be_held_is_told_as_the_wrench_that_is_left() -> None:
    p = plan(ARM, Hold(ROD, (0.0, 0.0, -0.02), 0.1), SCENE, 50.0, starts=1)
    assert not p.reached
    assert "is left" in p.outcome


@pytest.mark.slow
def test_a_hold_whose_friction_is_just_enough_is_an_optimum_at_the_edge_of_its_cone() -> None:
    """Cones with a tolerance of a thousandth of the wrench missed the wrench by as much."""
    p = plan(ARM, Hold(ROD, wrench(ASIDE), 0.28), SCENE, 50.0, starts=1)
    assert p.reached, p.outcome
    assert p.effort > 0.582


def test_a_moment_that_no_force_at_a_point_has_is_left_over_a_tenth_of_the_arm(
    held: ContactPlan,
) -> None:
    [grip] = held.grips
    force, center = -grip.normal - grip.tangential, np.array([0.2, 0.0, -0.04])
    radial = (grip.point - center) / np.linalg.norm(grip.point - center)
    for more in (0.0, 1e-4):
        moment = np.cross(grip.point - center, force) + more * radial
        asked = Hold(ROD, (*force.tolist(), *moment.tolist()), FRICTION)
        found = changed(held, targets=(asked,)).certificate
        size = np.linalg.norm([*force, *moment / (0.1 * ARM.length)])
        left = more / (0.1 * ARM.length) * np.linalg.norm(radial) / size
        assert found.equality[WRENCH] == pytest.approx(left, rel=1e-4, abs=1e-6)


def test_what_is_pressed_at_an_edge_balances_just_that_force() -> None:
    """The normals of the surface are undefined at an edge: forces were lost."""
    box = Box((0.18, 0.0, -0.05), (0.04, 0.2, 0.04))
    shape = settle(
        ARM, [0.0, 0.6, 0.0, 0.0], Scene(Extension(), ExactTendons(), Contact(box)), 1e-8
    )
    [touch] = shape.contacts
    x, _, z = touch.point - np.array(box.center)
    assert abs(x) == pytest.approx(0.02, abs=1e-9)
    assert z == pytest.approx(0.02, abs=1e-9)
    direction = touch.force / np.linalg.norm(touch.force)
    assert 0.01 < abs(direction[0]) < 0.99
    np.testing.assert_allclose(touch.normal, direction, atol=1e-9)
    hold = Hold(box, tuple(touch.force.tolist()), 0.0)
    np.testing.assert_allclose(Grasp.of(ARM, shape.contacts, hold).least, 0.0, atol=1e-12)
    [grip] = grips_of(shape, hold)
    np.testing.assert_allclose(grip.normal, -touch.force, atol=1e-12)


@pytest.mark.slow
def test_a_hold_is_optimal_on_the_mesh_on_which_it_was_found() -> None:
    """The curvature of the gap was that of the settled arm's mesh: the residual was 3e-6."""
    q = query(1)
    body = settle(q.arm, q.tensions, q.scene, 1e-6).contacts[0].obstacle
    hold = Hold(body, (1.4549e-3, 3.7327e-3, 9.4788e-4), 0.30848)
    p = plan(q.arm, hold, q.scene, 3 * float(q.tensions.max()))
    assert p.reached, p.outcome


def test_the_wrench_of_a_light_touch_grows_before_all_of_it_is_held() -> None:
    """Least violation of all of the wrench led to another edge of the object."""
    light = [0.0, 0.12, 0.0, 0.0]
    [touch] = settle(ARM, light, SCENE, 1e-8).contacts
    hold = Hold(ROD, tuple((6 * touch.force).tolist()), FRICTION)
    limits = TendonLimits((5.0,) * 4, (0.0,) * 4)
    problem = PlanningProblem(ARM, (hold,), SCENE, limits, NlpOptions(), 1e-6)
    program = TensionProgram(problem, COARSE)
    touching = program.settled(np.array(light))
    assert not presses_against(program, touching)
    assert presses_against(program.with_wrenches(-1.0), touching)
    heavy, path = with_growing_wrench(program, touching)
    assert path
    [grown] = equilibrium_contacts(heavy)
    assert Grasp.of(ARM, [grown], hold).least == pytest.approx(0.0, abs=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "body", "wrench", "friction"),
    [
        (2, 0, (0.0256205672643, -0.233291751029, 0.166808350536), 0.0),
        (13, 1, (0.00600962867246, -0.0491541276584, -0.0197786661905), 0.3),
        (31, 0, (2.1742077589864345e-4, -0.016803119742442602, -0.003764892401663686), 0.0),
    ],
    ids=["finer mesh", "grows", "other face"],
)
def test_attainable_wrenches_of_random_arms_are_held(
    seed: int, body: int, wrench: tuple[float, ...], friction: float
) -> None:
    """The wrench was off by 1.9e-6 on another mesh; no guess pressed in the right direction."""
    q = query(seed)
    p = plan(q.arm, Hold(q.obstacles[body], wrench, friction), q.scene, 3 * float(q.tensions.max()))
    assert p.reached, p.outcome
