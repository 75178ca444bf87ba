"""Tendons with friction in their sheaths: closed forms, and arms settled by SciPy."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from octoplan.model import Anchorage, Arm, Linear, Scene, Shape, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, TipLoad, Weight
from octoplan.model.extensions.friction import Friction
from tests.core.effects.bars import capstan, one_tendon
from tests.core.effects.cases import Array

L = 0.3
WAYS = pytest.mark.parametrize("way", [1, -1], ids=["in", "out"])


@WAYS
@pytest.mark.parametrize("mu", [0.05, 0.3, 1.0])
def test_a_tendon_loses_by_the_angle_that_the_arm_bends(mu: float, way: int) -> None:
    arm, T = one_tendon((0.01, 0.01), (5e-3, 5e-3)), 0.6
    shape = settle(arm, [T], Scene(Extension(), Friction(mu, way)), 1e-11)
    # With a constant offset the tendon is parallel to the midline.
    t = shape.frame(np.linspace(0, L, 40))[:, :, 0]
    theta = np.sum(np.arccos(np.sum(t[:-1] * t[1:], axis=1)))
    assert theta > 0.6
    assert shape.tension(0.0)[0] == pytest.approx(T, rel=1e-12)
    left = T * np.exp(-way * mu * theta)
    assert shape.tension(L)[0] == pytest.approx(left, rel=1e-9)


ARMS = {
    "uniform": ((0.01, 0.01), (5e-3, 5e-3), L),
    "conical body": ((0.012, 0.005), (4e-3, 4e-3), L),
    "conical": ((0.015, 0.0065), (7.5e-3, 1e-3), L),
    "widening tendon": ((0.012, 0.012), (1e-3, 9e-3), L),
    "steep": ((0.02, 0.004), (0.018, 0.002), 0.1),
}


def compare(name: str, T: float, mu: float, way: int, extension: bool, accuracy: float) -> None:
    scene = Scene(Friction(mu, way), *([Extension()] if extension else []))
    arm = one_tendon(*ARMS[name])
    shape = settle(arm, [T], scene, accuracy)
    x, y, angle, pull = capstan(*ARMS[name], T, mu, way, extension)
    # n of the paper's base is -y: the arm bends there.
    assert np.allclose(shape.tip, [x, -y, 0], rtol=0, atol=2 * accuracy * arm.length)
    t = shape.tip_frame[:, 0]
    assert np.allclose(t, [np.cos(angle), -np.sin(angle), 0], rtol=0, atol=100 * accuracy)
    assert shape.tension(shape.arm.length)[0] == pytest.approx(pull, rel=100 * accuracy)


@pytest.mark.quick(
    "uniform-bending-out",
    "conical body-extension-in",
    "conical-extension-out",
    "widening tendon-bending-in",
)
@WAYS
@pytest.mark.parametrize("extension", [True, False], ids=["extension", "bending"])
@pytest.mark.parametrize("name", ["uniform", "conical body", "conical", "widening tendon"])
def test_one_tendon_in_a_plane_is_an_initial_value_problem(
    name: str, extension: bool, way: int
) -> None:
    compare(name, 0.25, 0.4, way, extension, 1e-10)
    compare(name, 1.2 if way > 0 else 0.5, 0.4, way, extension, 1e-10)


@pytest.mark.parametrize("accuracy", [1e-5, 1e-6, 1e-8])
@pytest.mark.parametrize("T", [0.6, 0.9])
def test_paying_out_round_two_right_angles_makes_the_tip_taut(T: float, accuracy: float) -> None:
    compare("uniform", T, 0.6, -1, False, accuracy)


@pytest.mark.parametrize("T", [3.0, 20.0])
def test_on_a_steep_taper_friction_is_as_accurate_as_asked(T: float) -> None:
    compare("steep", T, 1.0, 1, False, 1e-9)


@pytest.mark.slow
@WAYS
@pytest.mark.parametrize("mu", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("name", ["uniform", "conical body", "conical", "widening tendon"])
def test_one_tendon_in_a_plane_from_slack_to_taut(name: str, mu: float, way: int) -> None:
    for T in np.geomspace(1e-3, 3.0 if way > 0 else 0.2, 6):
        compare(name, T, mu, way, True, 1e-10)


LENGTH = 0.3
NODES = np.cos(np.pi * (np.arange(33) + 0.5) / 33)  # in (-1, 1), excluding both ends


def papers_tangent(shape: Shape, j: int, s: Array, strain: Array) -> Array:
    """The unit tangents (N, 3) of a tendon in the base frame, c = t + y' d + y omega x d."""
    section, phi = shape.arm.tendons[j]
    at, path = shape.arm.sections[section].at, shape.arm.sections[section].offset
    d = np.array([0, np.cos(phi), np.sin(phi)])
    slope = (path.end - path.base) / at
    y = path.base + slope * s
    stretch = 1 + strain[:, 3:] if shape.scene.has(ExactTendons) else np.ones((s.size, 1))
    bent = np.array([1.0, 0, 0]) + y[:, None] * np.cross(strain[:, :3], d)
    c = stretch * bent + slope * d
    return np.einsum("nij,nj->ni", shape.frame(s), c / np.linalg.norm(c, axis=1)[:, None])


def turning(shape: Shape, j: int) -> float:
    """The angle that a tendon turns through between base and anchorage, kinks included."""
    ends = sorted({0.0, *(section.at for section in shape.arm.sections)})
    at = shape.arm.sections[shape.arm.tendons[j][0]].at
    total, before = 0.0, None
    for low, high in pairwise(end for end in ends if end <= at):
        s = (low + high) / 2 + (high - low) / 2 * NODES
        unit = papers_tangent(shape, j, s, shape.strain(s))
        course = [Chebyshev.fit(s, column, 32, (low, high)) for column in unit.T]
        dense = np.polynomial.legendre.leggauss(40)
        x = (low + high) / 2 + (high - low) / 2 * dense[0]
        speed = np.linalg.norm([p.deriv()(x) for p in course], axis=0)
        total += float(dense[1] @ speed) * (high - low) / 2
        first, last = (np.array([p(end) for p in course]) for end in (low, high))
        if before is not None:
            total += float(np.arctan2(np.linalg.norm(np.cross(before, first)), before @ first))
        before = last
    return total


def two_sections(angles: tuple[float, ...] = (0.0, np.pi / 2)) -> Arm:
    outer = Anchorage(LENGTH, Linear(7e-3, 2e-3), angles)
    return Arm(LENGTH, Linear(0.013, 0.006), (outer, Anchorage(0.13, Linear(8e-3, 3e-3), angles)))


PULLS = [[0.4, 0.3], [2.0, 3.0]]
SCENES = {
    "paper": (Extension(),),
    "paper, loaded": (Extension(), TipLoad((2e-3, -4e-3, 3e-3)), Weight((0.2, 0.1, 0.5))),
    "exact": (Extension(), ExactTendons()),
    "exact, loaded": (Extension(), ExactTendons(), TipLoad((2e-3, -4e-3, 3e-3), (1e-5, 0, 2e-5))),
    "bending, exact": (ExactTendons(), TipLoad(moment=(2e-5, 3e-5, 1e-5))),
}


SOME = pytest.mark.parametrize(
    "name",
    [
        "paper, loaded",
        "exact, loaded",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("paper", "exact", "bending, exact")),
    ],
)


@pytest.mark.quick("paper, loaded-each its own", "exact, loaded-each its own")
@pytest.mark.parametrize("direction", [1, (-1, 1, 1, -1)], ids=["in", "each its own"])
@SOME
def test_each_tendon_loses_by_all_that_it_turns(name: str, direction: Any) -> None:
    mu, arm = 0.25, two_sections()
    shape = settle(arm, PULLS, Scene(*SCENES[name], Friction(mu, direction)), 1e-9)
    ways = np.broadcast_to(direction, 4)
    ends = [*shape.tension(arm.length)[:2], *shape.tension(0.13)[2:]]
    motors = np.ravel(PULLS)
    assert np.allclose(shape.tension(0.0), motors, rtol=1e-10, atol=0)
    for j in range(4):
        wanted = motors[j] * np.exp(-ways[j] * mu * turning(shape, j))
        assert ends[j] == pytest.approx(wanted, rel=1e-8)


@SOME
def test_a_tendon_that_goes_on_loses_a_kink_where_others_end(name: str) -> None:
    mu, arm = 0.5, two_sections()
    shape = settle(arm, PULLS, Scene(*SCENES[name], Friction(mu)), 1e-9)
    beyond = 0.13 + 1e-7 * np.array([1.0, 2.0])
    for j in (0, 1):
        near = papers_tangent(shape, j, np.array([0.13]), shape.strain(np.array([0.13])))[0]
        far = papers_tangent(shape, j, beyond, shape.strain(beyond))
        angle = float(np.arccos(min(1.0, near @ (2 * far[0] - far[1]))))
        before, after = shape.tension(0.13)[j], shape.tension(0.13 * (1 + 1e-12))[j]
        assert after / before == pytest.approx(np.exp(-mu * angle), abs=1e-8)
        assert angle > 1e-4


def bends(scene: Scene, pulls: Array) -> Array:
    """The angle between base and tip at each pull."""
    arm = two_sections()
    frames = [settle(arm, [[T, 0.7 * T], [0, T]], scene, 1e-6).tip_frame for T in pulls]
    return np.array([np.arccos(min(1.0, frame[0, 0])) for frame in frames])


def test_pulling_in_and_paying_out_make_a_loop_that_opens_with_roughness() -> None:
    pulls = np.linspace(0, 0.8, 5)
    smooth = bends(Scene(Extension()), pulls)
    areas = [0.0]
    for mu in (0.1, 0.3):
        out, back = (bends(Scene(Extension(), Friction(mu, way)), pulls) for way in (1, -1))
        assert abs(out[0]) < 1e-7
        assert abs(back[0]) < 1e-7
        assert np.all(out[1:] < smooth[1:])
        assert np.all(smooth[1:] < back[1:])
        areas.append(np.trapezoid(back - out, pulls))
    assert np.all(np.diff(areas) > 0)
    assert areas[2] / areas[1] == pytest.approx(3, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_friction_keeps_no_arm_from_settling(mu: float) -> None:
    arm, rng = Arm.from_paper("table-4"), np.random.default_rng(0)
    for _ in range(60):
        T = rng.uniform(size=(3, 4)) * [[0.1], [1], [3]] * (rng.uniform(size=(3, 4)) < 0.4)
        assert settle(arm, T, Scene(Extension(), Friction(mu)), 1e-7).error <= 1e-7


@pytest.mark.parametrize(
    ("arm", "pulled", "accuracy"),
    [
        ("section-5.2", {3: 1.3088}, 1e-6),
        ("section-5.2", {3: 0.8494}, 1e-4),
        ("table-4", {3: 0.4773, 5: 0.5606, 9: 20.1486}, 1e-5),
    ],
)
def test_errors_are_true_where_an_arm_bends_to_both_sides(
    arm: str, pulled: dict[int, float], accuracy: float
) -> None:
    """How fast tendons turn has a kink between, and estimates counted on order five."""
    scene, given = Scene.silicone(Weight(), Buoyancy(), Friction(0.1)), Arm.from_paper(arm)
    T = np.zeros(given.n_tendons)
    T[[*pulled]] = [*pulled.values()]
    shape, fine = (settle(given, T, scene, each) for each in (accuracy, 1e-2 * accuracy))
    gap = np.linalg.norm(shape.tip - fine.tip) / given.length
    assert gap <= shape.error + fine.error <= 1.01 * accuracy
