"""Meshes have the nodes that they must, and halve when refined."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm
from model.mesh import graded
from tests.model.cases import arm_of, random_rod

SEEDS = range(12)


@pytest.mark.parametrize("refinement", [1, 3, 8])
@pytest.mark.parametrize("seed", SEEDS)
def test_every_place_where_strains_are_not_smooth_is_a_node(seed: int, refinement: int) -> None:
    rod = random_rod(np.random.default_rng(seed))
    mesh = graded(arm_of(rod), refinement)
    assert (mesh.s[0], mesh.s[-1]) == (0, rod.length)
    assert np.all(np.diff(mesh.s) > 0)
    ends = [section.at for section in rod.sections]
    assert np.all(np.isin(ends, mesh.s))
    knots = [float(x) for x in rod.radius.x[1:-1]]
    assert all(np.abs(mesh.s - place).min() <= 1e-9 * rod.length for place in knots)


@pytest.mark.parametrize("seed", SEEDS)
def test_each_step_knows_the_sections_that_cross_it(seed: int) -> None:
    rod = random_rod(np.random.default_rng(seed))
    mesh = graded(arm_of(rod), 2)
    assert mesh.active.size == mesh.steps == mesh.s.size - 1
    middle = (mesh.s[:-1] + mesh.s[1:]) / 2
    assert np.array_equal(mesh.active, [rod.active(s) for s in middle])


@pytest.mark.parametrize("name", ["table-2", "table-4"])
def test_doubling_the_refinement_halves_every_step(name: str) -> None:
    arm = Arm.from_paper(name)
    coarse, fine = graded(arm, 3), graded(arm, 6)
    assert fine.steps == 2 * coarse.steps
    assert np.abs(fine.s[::2] - coarse.s).max() <= 1e-15
    ratio = np.diff(fine.s)[::2] / np.diff(coarse.s)
    assert np.all((ratio > 0.45) & (ratio < 0.55))


def test_steps_are_shorter_where_the_arm_is_slender() -> None:
    steps = np.diff(graded(Arm.from_paper("table-4"), 8).s)
    assert steps[0] > 2 * steps[-1]


def test_places_asked_for_are_nodes_once() -> None:
    arm = Arm.from_paper("table-4")
    wanted = (0.05, 0.1, 0.135 + 1e-12, 0.4, 0.45)
    mesh = graded(arm, 1, wanted)
    assert np.all(np.diff(mesh.s) > 1e-6)
    assert np.abs(mesh.s[[mesh.node(s) for s in wanted]] - wanted).max() <= 1e-11
    assert {0.05, 0.1, 0.4} <= set(mesh.s)
