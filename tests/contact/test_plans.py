"""Plans and motions of an arm in contact: targets, rates, complementarity, and the way."""

from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.anchorage import Anchorage, Material
from octoplan.model.effects import ExactTendons, Extension, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Box, HalfSpace, Sphere
from octoplan.model.paths import Linear
from octoplan.planner import Plan, plan, trajectory
from octoplan.planner.targets import TipPosition
from tests.contact.cases import bar, distance
from tests.core.planner.cases import changed

ARM = bar(0.3, 0.006, 2e7)
FLOOR = HalfSpace((0, 0, -0.03), (0, 0, 1))
SCENE = Scene(Extension(), ExactTendons(), Weight(), Contact(FLOOR))


def leaning(T: float) -> Shape:
    shape = settle(ARM, [T, 0.0, 0.0, 0.5], SCENE, 1e-9)
    assert shape.contacts
    return shape


@pytest.fixture(scope="module")
def first() -> Plan:
    """The plan for the tip of an arm that the floor carries."""
    return plan(ARM, TipPosition(tuple(leaning(1.0).tip)), SCENE, 30.0, starts=1)


@pytest.mark.slow
def test_a_tip_is_brought_to_a_place_on_the_floor_that_carries_the_arm(first: Plan) -> None:
    assert first.reached, str(first.certificate)
    assert first.shape.contacts
    assert first.certificate.complementarity < 1e-8
    assert first.certificate.stability > 0
    assert np.linalg.norm(first.tip - leaning(1.0).tip) < 1e-6 * ARM.length
    assert first.effort < np.hypot(1.0, 0.5) + 1e-6
    assert "Reached" in first.outcome
    assert "complementarity" in str(first.certificate)


def test_a_force_across_a_gap_is_no_contact(first: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    touches = tuple(replace(touch, gap=1e-3) for touch in first.shape.contacts)
    monkeypatch.setattr(Shape, "contacts", touches)
    pressed = max(float(np.linalg.norm(touch.force)) for touch in touches)
    spoilt = changed(first, starts=first.solution.starts).certificate
    assert spoilt.complementarity == pytest.approx(1e-3 * pressed)
    assert not spoilt.passed


@pytest.mark.slow
def test_a_motion_leads_through_contact_and_is_certified_on_its_way(first: Plan) -> None:
    tip = leaning(2.0).tip
    asked = {"rate_max": 2.0, "start": first, "accuracy": 1e-5}
    found = trajectory(ARM, [TipPosition(tuple(tip))], SCENE, 30.0, **asked)
    assert found.certificate.passed, found.outcome
    assert found.reached == (True,)
    assert found.certificate.jumps == ()
    rates = np.abs(np.diff(found.flat, axis=0)) / np.diff(found.times)[:, None]
    assert rates.max() <= 2.0 * (1 + 1e-9)
    s = np.linspace(0, ARM.length, 1001)
    shape = found.shapes[-1]
    assert np.linalg.norm(shape.tip - tip) < 1e-5 * ARM.length
    gap = distance(FLOOR, shape.position(s)) - ARM.outer_radius(s)[0]
    assert gap.min() > -1e-8 * ARM.length
    assert shape.contacts
    for touch in shape.contacts:
        assert touch.force @ (shape.position(touch.s) - touch.point) >= 0
        assert abs(touch.gap) < 1e-8 * ARM.length


BOX = Box(
    (0.15457, 0.03246, 0.03502),
    (0.0598, 0.02974, 0.02081),
    (
        (0.18293298329188432, 0.5863243602212709, -0.7891509793664634),
        (-0.7150168013842498, -0.47156847441085603, -0.5161144714886938),
        (-0.674749210716224, 0.6586705690653979, 0.3329663407686993),
    ),
)


@pytest.mark.slow
def test_a_plan_that_begins_in_contact_lets_go_where_nothing_has_to_press() -> None:
    """The search ended with a touch without force, for more effort, and was not certified."""
    arm, target = Arm.from_paper("table-2"), TipPosition((0.29957, 0.010395, 0.023342))
    p = plan(arm, target, Scene(Extension(), Contact(BOX)), 3.0, starts=1)
    assert p.reached, p.outcome
    assert not p.shape.contacts
    free = plan(arm, target, Scene(Extension()), 3.0)
    assert p.effort == pytest.approx(free.effort, rel=1e-6)


@pytest.mark.slow
def test_a_plan_in_contact_passes_no_arm_that_is_crushed() -> None:
    """Tensions that crush the arm were the optimum, and the outcome was an error."""
    target = TipPosition((0.29957, 0.010395, 0.023342))
    p = plan(
        Arm.from_paper("table-4"),
        target,
        Scene(Extension(), Contact(BOX)),
        3.0,
        starts=1,
    )
    assert p.reached, p.outcome


@pytest.mark.slow
def test_a_tip_of_a_heavy_arm_is_met_on_finer_meshes() -> None:
    """The tip was 4.8e-7 of the length off: it converges with the square of the mesh width."""
    arm, ball = Arm.from_paper("table-2"), Sphere((0.0362, -0.013, -0.0884), 0.0567)
    scene = Scene.silicone() + Weight() + Contact(ball)
    target = TipPosition((0.13458, 0.01136, -0.24109))
    p = plan(arm, target, scene, 3.1, starts=1, accuracy=1e-7)
    assert p.reached, p.outcome
    assert p.shape.contacts


def test_a_tip_that_the_arm_meets_without_a_touch_is_planned() -> None:
    """Quantities at the contacts were requested without a contact, which raised an error."""
    arm = bar(0.3, 0.006, 2e5)
    scene = Scene(Extension(), ExactTendons(), Contact(Sphere((0.15, 0.0, 0.2), 0.02)))
    tip = tuple(settle(arm, (0.0, 0.3, 0.0, 0.0), scene).tip.tolist())
    result = plan(arm, TipPosition(tip), scene, 5.0)
    assert result.reached
    assert not result.shape.contacts


@pytest.mark.slow
def test_an_optimum_at_its_margin_that_the_arm_does_not_come_to_from_rest_has_a_load_path() -> None:
    """From rest the arm leans on the ball's other side under these tensions: this counted as near.

    Differences for the stability were 2 to 30 % off, by which steps crept along the margin.
    """
    angles = (1.4239418, 5.8357234, 2.4729634), (2.9439356, 2.8769955, 1.8665278, 3.3980446)
    arm = Arm(
        0.08480579,
        Linear(0.0031121043, 0.001580778),
        (
            Anchorage(0.08480579, Linear(0.0013816783, 0.00070181668), angles[0]),
            Anchorage(0.024428402, Linear(0.0027053546, 0.0023219058), angles[1]),
        ),
        Material(96362.693, 0.36855378),
    )
    ball = Sphere((0.0282586, 0.016436309, -0.0059339443), 0.0078691892)
    scene = Scene(Extension(), ExactTendons(), Contact(ball))
    tip = TipPosition((0.033076796, 0.070428727, -0.0064174371))
    found = plan(arm, tip, scene, 0.1952019, stability_margin=0.0)
    assert found.reached, str(found.certificate)
    assert found.solution.load_path
    assert found.effort < 0.0456
    assert found.shape.stability == pytest.approx(0.01, rel=1e-3)
    steady = plan(arm, tip, scene, 0.1952019)
    assert steady.reached and not steady.solution.load_path
    assert steady.shape.stability == pytest.approx(0.1, rel=1e-3)
    assert found.effort < steady.effort < 1.05 * found.effort
    rested = settle(arm, found.tensions, scene)
    assert np.linalg.norm(rested.tip - found.tip) > 0.5 * arm.length
