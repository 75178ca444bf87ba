"""Plans for targets in a plane of symmetry lie in it, or say that they have a mirror image."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Extension, TipLoad, Weight
from planner import plan
from planner.mirror import mirrors
from planner.program.limits import Limits
from planner.targets import TipPosition
from tests.planner.cases import moderate

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())


def test_four_tendons_have_four_planes_and_unequal_limits_fewer() -> None:
    angles = [mirror.angle for mirror in mirrors(ARM, Limits.of(ARM, 20.0))]
    assert np.allclose(np.degrees(angles), [0, 45, 90, 135])
    upper = np.full((3, 4), 20.0)
    upper[1, 0] = 5.0
    (mirror,) = mirrors(ARM, Limits.of(ARM, upper))
    assert mirror.angle == 0
    assert mirror.tendons.tolist() == [0, 3, 2, 1, 4, 7, 6, 5, 8, 11, 10, 9]


@pytest.mark.parametrize("angle", [0, 45, 90, 135])
def test_mirrored_tensions_have_the_mirrored_shape(angle: int) -> None:
    s = np.linspace(0, ARM.length, 5)
    T = np.ravel(moderate()) * np.random.default_rng(angle).uniform(0.5, 1, 12)
    every = {round(np.degrees(m.angle)): m for m in mirrors(ARM, Limits.of(ARM, 20.0))}
    expected = every[angle].poses(ARM, settle(ARM, T, PAPER, 1e-9).poses(s))
    found = settle(ARM, T[every[angle].tendons], PAPER, 1e-9).poses(s)
    signs = np.sign((expected[:, :4] * found[:, :4]).sum(axis=1))[:, None]
    assert np.allclose(expected[:, 4:], found[:, 4:], atol=1e-9)
    assert np.allclose(expected[:, :4] * signs, found[:, :4], atol=1e-8)


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
    ((angle, other),) = p.mirror_images
    assert np.isclose(np.degrees(angle), 45)
    assert "mirror image across the plane at 45 deg" in p.outcome
    assert np.isclose(np.linalg.norm(other), p.effort)
    tip = settle(ARM, other, PAPER, 1e-9).tip
    assert np.linalg.norm(tip - target.position) < 1e-6 * ARM.length


@pytest.mark.parametrize("seed", range(4))
def test_targets_in_a_plane_get_plans_in_it(seed: int) -> None:
    rng, T = np.random.default_rng(seed), np.zeros((3, 4))
    T[:, [0, 2]] = rng.exponential(1, (3, 2)) * np.array([[0.2], [1.0], [3.0]])
    p = plan(ARM, TipPosition(tuple(settle(ARM, T, PAPER).tip)), PAPER, 20.0)
    assert np.allclose(p.tensions[:, 1], p.tensions[:, 3], atol=1e-6)
    assert not p.mirror_images
    assert "mirror" not in p.outcome


@pytest.mark.parametrize("load", [Weight(), TipLoad((0.0, 0.0, 2e-3), (0.0, 0.0, 0.0))])
def test_loads_across_the_plane_have_no_mirror_image(load: object) -> None:
    scene, T = Scene(Extension(), load), np.zeros((3, 4))
    T[2, [0, 1]] = 1.0
    p = plan(ARM, TipPosition(tuple(settle(ARM, T, scene).tip)), scene, 20.0, starts=2)
    assert p.reached
    assert not p.mirror_images
