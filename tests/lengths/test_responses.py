"""Tensions and tips after changes of lengths: derivatives, stiffness, paths."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle, settle_many
from octoplan.model.compliance import length_response
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, Weight
from octoplan.model.stiffness import stiffness
from octoplan.model.tendons import tendon_lengths
from tests.lengths.cases import EXACT, PAPER, SCENES, check_complementary

ARM = Arm.from_paper("table-2")
WATER = Scene(Extension(), ExactTendons(), NeoHookean(), Weight(), Buoyancy(1000.0))
T = np.zeros(12)
T[[0, 5, 10]] = 0.5, 1.0, 2.0


def lengths_of(scene: Scene) -> np.ndarray:
    """Return the lengths of the shape under T, of slack tendons a little more."""
    return settle(ARM, T, scene, 1e-10).tendon_lengths + 5e-3 * (T == 0)


@pytest.mark.quick("scene0-None", "scene1-200.0")
@pytest.mark.parametrize(("scene", "own"), [(EXACT, None), (EXACT, 200.0), (WATER, 200.0)])
def test_derivatives_are_those_of_differences(scene: Scene, own: float | None) -> None:
    lengths, step = lengths_of(scene), 1e-6
    shape = settle(ARM, scene=scene, accuracy=1e-10, lengths=lengths, tendon_EA=own)
    found = length_response(shape)
    assert np.array_equal(found.taut, shape.tensions > 0)
    for j in (0,):
        ends = []
        for sign in (1, -1):
            moved = lengths + sign * step * (np.arange(12) == j)
            options = {"lengths": moved, "tendon_EA": own, "near": shape}
            ends.append(settle(ARM, scene=scene, accuracy=1e-10, **options))
        tip = (ends[0].tip - ends[1].tip) / (2 * step)
        pulls = (ends[0].tensions - ends[1].tensions) / (2 * step)
        assert found.tip[:, j] == pytest.approx(tip, abs=1e-6 * np.abs(tip).max())
        assert found.tension[:, j] == pytest.approx(pulls, abs=1e-6 * np.abs(pulls).max())
    slack = np.flatnonzero(shape.tensions == 0)
    assert not found.tip[:, slack].any()


def test_stiffness_by_lengths_is_that_of_locked_tendons() -> None:
    lengths = lengths_of(WATER)
    locked = stiffness(ARM, T, WATER, "length", release=True, accuracy=1e-7)
    found = stiffness(ARM, scene=WATER, lengths=lengths, accuracy=1e-7)
    assert found.hold == "length"
    assert found.locked == (0, 5, 10)
    scale = np.abs(locked.compliance).max()
    assert found.compliance == pytest.approx(locked.compliance, abs=1e-6 * scale)


def test_shapes_are_followed_along_a_path_of_lengths() -> None:
    lengths = lengths_of(WATER)
    shape = settle(ARM, scene=WATER, lengths=lengths)
    for step in range(1, 4):
        moved = lengths + step * 1e-3 * np.array([1, 0, -1, 0] * 3)
        shape = settle(ARM, scene=WATER, lengths=moved, near=shape)
        cold = settle(ARM, scene=WATER, lengths=moved)
        assert shape.tip == pytest.approx(cold.tip, abs=2e-6 * ARM.length)
        check_complementary(shape)


@pytest.mark.parametrize("scene", [EXACT, WATER])
def test_a_shape_nearby_does_not_keep_the_tensions_that_forces_held_there(scene: Scene) -> None:
    """The lengths stayed unchanged, without an error."""
    lengths, given = lengths_of(scene), np.full(12, np.nan)
    lengths[:4], given[:4] = np.nan, T.ravel()[:4]
    shape = settle(ARM, given, scene, lengths=lengths)
    given[:4] += 0.02
    found = settle(ARM, given, scene, lengths=lengths, near=shape)
    assert np.array_equal(found.tensions[:4], given[:4])
    assert found.tip == pytest.approx(settle(ARM, given, scene, lengths=lengths).tip, abs=1e-6)


def test_many_sets_of_lengths_settle_as_each_does() -> None:
    lengths = lengths_of(EXACT)
    sets = [lengths, lengths - 2e-3]
    found = settle_many(ARM, lengths=sets, scene=EXACT)
    for i, own in enumerate(sets):
        alone = settle(ARM, lengths=own, scene=EXACT)
        assert np.array_equal(found.tip[i], alone.tip)
        assert np.array_equal(found.tensions[i], alone.tensions)
        assert np.array_equal(found.slack[i], alone.slack.ravel())


_SCENES = {"paper": PAPER["paper"], **{k: SCENES[k] for k in ("inextensible", "exact", "silicone")}}


def tapered(counts: tuple[int, ...]) -> Arm:
    """Return an arm whose sections, tip to base, have so many tendons."""
    ends = np.linspace(0.3, 0.3 / len(counts), len(counts))
    sections = tuple(
        Anchorage(at, Linear(6e-3, 3e-3), tuple(0.3 * i + 2 * np.pi / n * np.arange(n)))
        for i, (at, n) in enumerate(zip(ends, counts, strict=True))
    )
    return Arm(0.3, Linear(1e-2, 6e-3), sections, Material(E=2e5))


# Six tendons are as many as there are resultants, which were once taken for tensions.
@pytest.mark.parametrize("counts", [(4,), (3, 3), (4, 4)])
@pytest.mark.parametrize("scene", _SCENES.values(), ids=_SCENES)
def test_jacobian_of_lengths_are_those_of_differences(
    scene: Scene, counts: tuple[int, ...]
) -> None:
    arm, step = tapered(counts), 1e-5
    lengths = tendon_lengths(arm, scene)
    T = np.random.default_rng(1).uniform(0, 0.4, arm.n_tendons)
    found = lengths(T).length_tension
    sides = [[lengths(T + side * e).lengths for side in (step, -step)] for e in np.eye(T.size)]
    differences = np.array([(more - less) / (2 * step) for more, less in sides]).T
    assert found == pytest.approx(differences, abs=1e-7 * np.abs(found).max())
