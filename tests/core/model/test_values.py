"""Arms, scenes and shapes are values: they compare, hash and pickle, without idle data."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Sampled, Scene, settle, settle_many
from octoplan.model.effects import Extension
from tests.core.model.cases import paper_tensions

SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}


def curved() -> Arm:
    s, grid = (0.0, 0.1, 0.2, 0.3), (0.0, 0.05, 0.1, 0.15, 0.2)
    radius, offset = Sampled(s, (0.012, 0.01, 0.007, 0.006)), Sampled(grid, (5e-3,) * 5)
    return Arm(0.3, radius, (Anchorage(0.2, offset, (0.1, 2.0)),), Material(2e5, 0.4))


def test_an_arm_differs_by_every_field() -> None:
    arm = curved()
    assert arm == curved()
    assert hash(arm) == hash(curved())
    section = Anchorage(0.2, arm.sections[0].offset, (0.1, 2.1))
    others = [
        Arm(0.3, Linear(0.01, 0.007), arm.sections, arm.material),
        Arm(0.3, arm.radius, (section,), arm.material),
        Arm(0.3, arm.radius, arm.sections, Material(2e5, 0.41)),
        Arm(0.3, arm.radius, arm.sections, arm.material, tuple(map(tuple, np.eye(3)))),
        Arm(0.3, arm.radius, arm.sections, arm.material, base_position=(0, 0, 1)),
    ]
    assert len({arm, *others}) == 6


def test_lists_and_arrays_make_the_same_arm_as_tuples() -> None:
    arm = curved()
    path = Sampled(np.array(arm.radius.s), list(arm.radius.values))
    frame = np.array(arm.base_frame)
    assert Arm(0.3, path, list(arm.sections), arm.material, frame, [0, 0, 0]) == arm
    assert Anchorage(0.2, arm.sections[0].offset, np.array([0.1, 2.0])) == arm.sections[0]


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_shapes_pickle_and_read_the_same_there(scene: Scene) -> None:
    arm = Arm.from_paper("table-2")
    shape = settle(arm, paper_tensions(np.random.default_rng(1), "table-2"), scene)
    there = pickle.loads(pickle.dumps(shape))
    s = np.linspace(0, arm.length, 7)
    assert (there.arm, there.scene) == (arm, scene)
    assert (there.error, there.scheme, there.refinement) == (
        shape.error,
        shape.scheme,
        shape.refinement,
    )
    assert np.array_equal(there.tip, shape.tip)
    assert np.array_equal(there.position(s), shape.position(s))
    assert np.array_equal(there.strain(s), shape.strain(s))
    assert np.array_equal(there.tendon_lengths, shape.tendon_lengths)


def test_a_shape_does_not_change_when_what_it_returned_does() -> None:
    shape = settle(Arm.from_paper("table-2"), np.ones(12))
    tip, nodes = shape.tip, shape.s
    tip[:], nodes[:] = 7.0, 7.0
    assert not np.any(shape.tip == 7.0)
    assert not np.any(shape.s == 7.0)


def test_a_shape_does_not_change_when_the_tensions_given_do() -> None:
    T = paper_tensions(np.random.default_rng(1), "table-2")
    shape = settle(Arm.from_paper("table-2"), T)
    before = shape.strain(0.1)
    T[:] = 0
    assert np.array_equal(shape.strain(0.1), before)


@pytest.mark.quick("table-2-bare", "table-4-extension", "table-2-as_printed")
@pytest.mark.parametrize("key", SCENES)
@pytest.mark.parametrize("name", ["table-2", "table-4"])
def test_many_settle_as_one_by_one(name: str, key: str) -> None:
    arm = Arm.from_paper(name)
    sets = np.array([paper_tensions(np.random.default_rng(i), name) for i in range(50)])
    many = settle_many(arm, sets, SCENES[key])
    alone = [settle(arm, T, SCENES[key]) for T in sets]
    assert np.abs(many.tip - [shape.tip for shape in alone]).max() <= 1e-14
    assert np.abs(many.tip_frame - [shape.tip_frame for shape in alone]).max() <= 1e-13
    assert np.abs(many.error - [shape.error for shape in alone]).max() <= 1e-13
    rows = settle_many(arm, sets.reshape(50, 3, 4), SCENES[key])
    assert np.array_equal(rows.tip, many.tip)


def test_no_sets_settle_to_no_tips() -> None:
    many = settle_many(Arm.from_paper("table-2"), np.zeros((0, 3, 4)))
    assert (many.tip.shape, many.tip_frame.shape, many.error.shape) == ((0, 3), (0, 3, 3), (0,))


def test_tensions_read_the_same_flat_or_a_row_per_section() -> None:
    arm, T = Arm.from_paper("table-4"), np.arange(12) / 10
    rows = [list(row) for row in T.reshape(3, 4)]
    for given in (list(T), tuple(T), T.reshape(3, 4), rows):
        assert np.array_equal(arm.flat(given), T)
    assert np.array_equal(arm.by_section(T), T.reshape(3, 4))
    assert np.array_equal(settle(arm, rows).tip, settle(arm, T).tip)


def test_sections_may_have_different_numbers_of_tendons() -> None:
    sections = (
        Anchorage(0.3, Linear(4e-3, 2e-3), (0.0, 2.0, 4.0)),
        Anchorage(0.1, Linear(5e-3, 5e-3)),
    )
    arm = Arm(0.3, Linear(0.01, 0.005), sections)
    rows = [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6, 0.7]]
    flat = np.concatenate(rows)
    assert np.array_equal(arm.flat(rows), flat)
    assert np.array_equal(arm.by_section(flat), flat)
    assert [arm.tendon_name(j) for j in (0, 2, 3, 6)] == ["T_11", "T_13", "T_21", "T_24"]
    assert (arm.tendons_of(1), arm.tendons_of(2)) == ((0, 1, 2), (3, 4, 5, 6))
    assert np.array_equal(settle(arm, rows).tip, settle(arm, flat).tip)


ARMS = ("table-2", "table-4", "section-5.1", "section-5.2")


@pytest.mark.parametrize("arm", [curved(), *map(Arm.from_paper, ARMS)], ids=["curved", *ARMS])
def test_arms_pickle(arm: Arm) -> None:
    there = pickle.loads(pickle.dumps(arm))
    assert there == arm
    assert hash(there) == hash(arm)
    assert there.tendons == arm.tendons
