"""Guesses of holds: arms that have just touched the object, ranked by the wrench that is left."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.touches import equilibrium_contacts
from octoplan.model.extensions.obstacles import Box, Capsule, Sphere
from octoplan.planner import plan
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.extensions.contact.load_path import settled_along
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.extensions.contact.search import COARSE
from octoplan.planner.extensions.contact.touching import arms_that_touch, balance_left
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from tests.contact.cases import bar, distance
from tests.oracles import Array
from tests.random_arms import random_arm

ARM = bar(0.3, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))


def wrench_of(force: Array, point: Array, centre: Array) -> Array:
    """Return force and moment over a tenth of the arm's length."""
    return np.append(force, np.cross(point - centre, force) / (0.1 * ARM.length))


def draw(rng: np.random.Generator, friction: float) -> tuple[Hold, Array, Array]:
    """Return a hold of a ball by a random wrench, a point of the ball, and its normal."""
    ball = Sphere((0.2, 0.0, -0.05), 0.03)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    wrench = rng.normal(size=int(rng.choice([3, 6])))
    wrench[3:] *= ball.radius
    hold = Hold(ball, tuple(wrench.tolist()), friction)
    return hold, np.array(ball.center) + ball.radius * normal, normal


def test_balance_left_without_friction_is_a_nonnegative_fit() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        hold, point, normal = draw(rng, 0.0)
        m = len(hold.wrench)
        column = wrench_of(-normal, point, np.array((0.2, 0.0, -0.05)))[:m]
        _, left = nnls(column[:, None], -hold.scaled(ARM))
        [found] = balance_left(ARM, hold, point[None], normal[None])
        assert found == pytest.approx(left / hold.size(ARM), abs=1e-9)


def test_balance_left_is_no_less_than_the_least_of_the_cone() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        hold, point, normal = draw(rng, 0.4)
        across = np.linalg.svd(normal[None])[2][1:]
        m = len(hold.wrench)

        def left(x: Array, hold: Hold = hold, point: Array = point, n: Array = normal) -> float:
            pressed = x[0] ** 2
            tangential = 0.4 * pressed * np.tanh(x[1]) * np.array([np.cos(x[2]), np.sin(x[2])])
            force = -pressed * n + tangential @ across  # noqa: B023
            wrench = wrench_of(force, point, np.array((0.2, 0.0, -0.05)))[: len(hold.wrench)]
            return float(np.linalg.norm(hold.scaled(ARM) + wrench)) / hold.size(ARM)

        starts = [(1.0, 1.0, angle) for angle in (0.0, 1.6, 3.1, 4.7)]
        least = min(minimize(left, start).fun for start in starts)
        [found] = balance_left(ARM, hold, point[None], normal[None])
        assert least - 1e-4 < found <= 1 + 1e-12
        # A force inside of the cone balances its own wrench.
        force = -normal + 0.3 * across[0]
        own = -wrench_of(force, point, np.array((0.2, 0.0, -0.05)))[:m]
        own[3:] *= 0.1 * ARM.length
        held = Hold(hold.obstacle, tuple(own.tolist()), 0.4)
        assert balance_left(ARM, held, point[None], normal[None]) == pytest.approx(0.0, abs=1e-9)


def test_arms_that_touch_press_lightly_and_settle_along_their_paths() -> None:
    limits = TendonLimits((5.0,) * 4, (0.0,) * 4)
    hold = Hold(ROD, (0.0, 0.0, 0.02), 0.3)
    problem = PlanningProblem(ARM, (hold,), SCENE, limits, NlpOptions(), 1e-6)
    program = TensionProgram(problem, COARSE)
    found = list(islice(arms_that_touch(program, hold), 3))
    assert len(found) == 3
    for path, point in found:
        [touch] = equilibrium_contacts(point)
        assert 0 < touch.force @ touch.normal < 0.05 * ARM.bending_force
        assert np.allclose(point.tensions, path[-1])
        shape = settled_along(ARM, path[:-1], np.array(path[-1]), SCENE, 1e-6)
        assert np.allclose(shape.tip, point.poses[-1, 4:], atol=1e-4 * ARM.length)
        line = shape.position(np.linspace(0.0, ARM.length, 501))
        assert distance(ROD, line).min() > 0.006 - 1e-5


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
def test_the_first_guess_touches_the_side_that_the_wrench_needs(side: float) -> None:
    ball = Sphere((0.2, 0.0, -0.04), 0.02)
    limits = TendonLimits((5.0,) * 4, (0.0,) * 4)
    hold = Hold(ball, (0.0, 0.02 * side, 0.0), 0.0)
    scene = Scene(Extension(), ExactTendons(), Contact(ball))
    problem = PlanningProblem(ARM, (hold,), scene, limits, NlpOptions(), 1e-6)
    _, point = next(arms_that_touch(TensionProgram(problem, COARSE), hold))
    [touch] = equilibrium_contacts(point)
    assert touch.normal[1] * side > 0.8


@pytest.mark.slow
def test_an_object_is_held_from_behind() -> None:
    """Arms that reach the box from rest touch its front; the wrench needs its far side."""
    arm, _ = random_arm(np.random.default_rng(87901749), 1.0, 4, 5)
    frame = (
        (0.19129515540201886, 0.9772936765178216, 0.09112207942094368),
        (-0.42655852338174854, -0.0008366557516168742, 0.9044595768399687),
        (0.8839988629235331, -0.21188763495171828, 0.4167128993737387),
    )
    centre = (0.07153453537959255, 0.0004614002917698477, -0.022905696242120216)
    size = (0.010585540237777257, 0.006002010667751678, 0.005397733254348434)
    box = Box(centre, size, frame)
    force = (-0.008925219959362692, 0.004086132855614265, -0.006917130225261238)
    moment = (2.446400359718007e-06, 9.399178369710006e-06, 2.3957377833634654e-06)
    scene = Scene(Extension(), ExactTendons(), Contact(box))
    p = plan(arm, Hold(box, force + moment, 0.0), scene, 1.18)
    assert p.reached, p.outcome
    again = settle(arm, p.tensions, scene, 1e-8, near=p.shape)
    total = sum((touch.force for touch in again.contacts), np.zeros(3))
    np.testing.assert_allclose(total, force, rtol=1e-4)
