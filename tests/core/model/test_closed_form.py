"""Shapes of random arms against section-by-section moment balance and SciPy integration."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Scene, Shape, settle
from octoplan.model.effects import Extension
from tests.collocation import collocated
from tests.core.model.cases import arm_of, mild_tensions, random_rod
from tests.oracles import Array, Rod, poses, strain, tendon_length

SEEDS = [*range(10), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(10, 20))]


def drawn(seed: int) -> tuple[Rod, Array, bool, Shape]:
    rng = np.random.default_rng(seed)
    rod = random_rod(rng)
    T, extension = mild_tensions(rng, rod), seed % 3 != 2
    scene = Scene(Extension()) if extension else Scene()
    return rod, T, extension, settle(arm_of(rod), T, scene, accuracy=1e-11)


def places(rod: Rod, count: int) -> Array:
    inside = np.random.default_rng(7).uniform(0, rod.length, count)
    return np.unique([0.0, *inside, *(section.at for section in rod.sections), rod.length])


@pytest.mark.parametrize("seed", SEEDS)
def test_strains_balance_every_cross_section(seed: int) -> None:
    rod, T, extension, shape = drawn(seed)
    s = places(rod, 40)
    wanted = np.array([strain(rod, T, x, extension) for x in s])
    found = shape.strain(s)
    bend = np.linalg.norm(wanted[:, :3], axis=1)
    assert bend.max() * rod.length > 0.1
    assert np.all(np.linalg.norm(found - wanted, axis=1)[bend == 0] == 0)
    assert np.all(np.linalg.norm((found - wanted)[:, :3], axis=1) <= 1e-9 * bend)
    assert np.all(np.abs((found - wanted)[:, 3]) <= 1e-9 * np.abs(wanted[:, 3]))
    assert np.all(found[:, 0] == 0), "no torsion without loads"


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_along_the_arm_are_those_of_integrated_frames(seed: int) -> None:
    rod, T, extension, shape = drawn(seed)
    s = places(rod, 3)
    position, frame = poses(rod, T, s, extension)
    assert np.linalg.norm(shape.position(s) - position, axis=1).max() <= 1e-9 * rod.length
    assert np.abs(shape.frame(s) - frame).max() <= 1e-9
    assert np.array_equal(shape.tip, shape.position(rod.length))
    assert np.array_equal(shape.tip_frame, shape.frame(rod.length))


@pytest.mark.parametrize("seed", SEEDS[:10])
def test_tendon_lengths_are_the_integrals_of_their_tangents(seed: int) -> None:
    rod, T, extension, shape = drawn(seed)
    tendons = shape.arm.tendons
    for index in np.random.default_rng(seed).permutation(len(tendons))[:3]:
        wanted = tendon_length(rod, T, *tendons[index], extension)
        assert abs(shape.tendon_lengths[index] - wanted) <= 1e-9 * rod.length


@pytest.mark.quick("0-2", "2-3", "5-3")
@pytest.mark.parametrize("stages", [2, 3])
@pytest.mark.parametrize("seed", SEEDS[:6])
def test_collocation_agrees_between_the_nodes(seed: int, stages: int) -> None:
    rod, T, _, wanted = drawn(seed)
    shape = collocated(wanted.arm, T, wanted.scene, stages, 96 if stages == 2 else 24)
    s = places(rod, 20)
    gap = np.linalg.norm(shape.position(s) - wanted.position(s), axis=1)
    bend = np.linalg.norm(wanted.strain(s), axis=1)
    assert gap.max() <= 1e-7 * rod.length
    assert np.linalg.norm(shape.strain(s) - wanted.strain(s), axis=1).max() <= 1e-6 * bend.max()
