"""Warm starts, results and refusals of estimate_load."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from octoplan import Arm, PointLoad, Scene, estimate_load, settle
from octoplan.model.effects import Extension, TipLoad, Weight
from octoplan.model.extensions.contact.effects import Contact, SelfContact
from octoplan.model.extensions.obstacles import Sphere
from tests.refusals import Refused, check_refusal

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())
PULLS = np.array([0.3, 0, 0, 0, 0.8, 0, 0, 0, 0, 1.0, 0, 0])
LOADED = settle(ARM, PULLS, SCENE + TipLoad((5e-4, 1e-3, -1.5e-3)))
TIP = LOADED.tip
POSE = (TIP, LOADED.tip_frame)
BALL = Sphere((0.2, 0.1, 0.1), 0.02)
estimated = partial(estimate_load, ARM, SCENE, PULLS)


def test_a_warm_estimate_is_the_cold_one() -> None:
    first = estimated(tip=TIP + 0.01, std=5e-4)
    cold, warm = (estimated(pose=POSE, std=5e-4, angle_std=0.01, near=x) for x in (None, first))
    off = np.concatenate([warm.force - cold.force, warm.moment - cold.moment])
    assert off @ cold.information @ off < 1e-4
    assert warm.covariance == pytest.approx(cold.covariance, rel=1e-2, abs=1e-16)


def test_tensions_may_change_between_estimates() -> None:
    first = estimated(tip=TIP, std=5e-4)
    after = estimate_load(ARM, SCENE, 1.1 * PULLS, tip=TIP, std=5e-4, near=first)
    again = estimate_load(ARM, SCENE, 1.1 * PULLS, tip=TIP, std=5e-4)
    off = after.force - again.force
    assert off @ again.information[:3, :3] @ off < 1e-4


def test_a_force_alone_starts_from_an_estimate_with_a_moment() -> None:
    shape = settle(ARM, PULLS, SCENE + PointLoad(ARM.length, (5e-4, 1e-3, 0.0), (1e-5, 2e-5, 0.0)))
    pose = (shape.tip, shape.tip_frame)
    first = estimated(pose=pose, std=5e-4, angle_std=0.01)
    cold, warm = (estimated(tip=shape.tip, std=5e-4, near=near) for near in (None, first))
    assert first.moment.any() and not warm.moment.any()
    off = warm.force - cold.force
    assert off @ cold.information[:3, :3] @ off < 1e-4


def test_the_load_is_an_effect_that_settles_to_the_measured_tip() -> None:
    found = estimated(tip=TIP, std=5e-4)
    assert settle(ARM, PULLS, SCENE + found.load).tip == pytest.approx(TIP, abs=5e-6)
    assert found.stable
    assert "Force" in repr(found) and "on the tip" in found.outcome


def test_the_outcome_names_the_place_of_a_load_below_the_tip() -> None:
    outcome = estimated(tip=TIP, std=5e-4, at=0.3).outcome
    assert " N at s = 300 mm." in outcome
    assert "tip" not in outcome


def test_small_regions_are_nearly_ellipsoids() -> None:
    small, large = (estimated(tip=TIP, std=std).nonlinearity() for std in (1e-5, 1e-3))
    assert small < 1e-4
    assert large == pytest.approx(100 * small, rel=0.1)


@pytest.mark.parametrize("miss", [1e-3, 1e-2])
def test_a_shape_that_no_load_explains_is_reported(miss: float) -> None:
    s = np.array([0.1, 0.2, 0.3, 0.45])
    places = LOADED.position(s)
    places[1] += miss
    points = [*zip(s, np.zeros((4, 3)), places, strict=True)]
    found = estimated(points=points, std=1e-4)
    assert "No load on the tip explains the shape" in found.outcome


def refused(**more: Any) -> Callable[[], object]:
    return partial(estimated, **{"tip": TIP, "std": 1e-4} | more)


def in_scene(scene: Scene) -> Callable[[], object]:
    return partial(estimate_load, ARM, scene, PULLS, tip=TIP, std=1e-4)


OFF = (0.0, 0.0, 0.0)
REFUSED: Refused = {
    "nothing measured": (refused(tip=None), "measurement", "tip, pose or points"),
    "two kinds": (refused(pose=POSE, angle_std=0.1), "measurement", "tip, pose or points"),
    "a tip in mm": (refused(tip=1e3 * TIP), "tip", "in mm"),
    "a tip of two": (refused(tip=TIP[:2]), "tip", "3 numbers"),
    "a tip that is NaN": (refused(tip=TIP * np.nan), "tip", "finite"),
    "no std": (refused(std=None), "std", "positive"),
    "a std of 0": (refused(std=0.0), "std", "positive"),
    "a std that underflows": (refused(std=1e-300), "std", "from 1e-30"),
    "a std that overflows": (refused(std=1e200), "std", "to 1e+30"),
    "stds of two": (refused(std=[1e-4, 1e-4]), "std", "3 numbers"),
    "an angle without a frame": (refused(angle_std=0.1), "angle_std", "without pose"),
    "a frame without an angle": (refused(tip=None, pose=POSE), "angle_std", "positive"),
    "a pose without a frame": (refused(tip=None, pose=TIP, angle_std=0.1), "pose", "frame"),
    "a left-handed frame": (
        refused(tip=None, pose=(TIP, np.diag([1.0, 1.0, -1.0])), angle_std=0.1),
        "pose",
        "right-handed",
    ),
    "no points": (refused(tip=None, points=[]), "points", "a sequence"),
    "a point without offset": (refused(tip=None, points=[(0.1, TIP)]), "points[0]", "o_t"),
    "points that were not seen": (
        refused(tip=None, points=[(0.1, OFF, None)]),
        "points",
        "at least one",
    ),
    "a point off the arm": (refused(tip=None, points=[(0.5, OFF, TIP)]), "points[0]", "on the arm"),
    "a place off the arm": (refused(at=0.5), "at", "0.45"),
    "a place by name": (refused(at="base"), "at", "tip"),
    "tensions of two": (partial(estimate_load, ARM, SCENE, [1, 2], tip=TIP, std=1), "tensions", ""),
    "a negative noise": (refused(tension_std=-1.0), "tension_std", ">= 0"),
    "moment as text": (refused(moment="yes"), "moment", "True, False or None"),
    "contact": (in_scene(Scene(Extension(), Contact(BALL))), "scene", "without contact"),
    "self-contact": (in_scene(Scene(SelfContact())), "scene", "SelfContact"),
    "printed": (in_scene(Scene.as_printed()), "scene", "hold under loads"),
    "near a shape": (refused(near=LOADED), "near", "a LoadEstimate"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_refused_by_name(name: str) -> None:
    check_refusal(*REFUSED[name])


def test_an_estimate_of_another_scene_is_no_start() -> None:
    first = estimated(tip=TIP, std=1e-4)
    scene = Scene(Extension(), Weight())
    attempt = partial(estimate_load, ARM, scene, PULLS, tip=TIP, std=1e-4, near=first)
    check_refusal(attempt, "near", "same arm, scene")


def test_a_region_of_force_and_moment_needs_both() -> None:
    found = estimated(pose=POSE, std=1e-4, angle_std=0.01)
    check_refusal(lambda: found.holds(found.force), "moment", "3 numbers")
    check_refusal(lambda: found.holds(found.force, found.moment, 1.5), "level")
    assert found.holds(found.force, found.moment)
