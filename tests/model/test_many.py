"""Many sets settle as each does alone, compiled or not; a bad one is a row of its reason."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from model import Arm, Scene, settle, settle_many
from model.effects import (
    Buoyancy,
    Contact,
    Current,
    Effect,
    ExactTendons,
    Extension,
    PointMass,
    SelfContact,
    TipLoad,
    Weight,
)
from model.errors import SnapError
from model.obstacles import Sphere
from model.paths import Array

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

WATER = (Weight(), Buoyancy(1000.0))
OFF_AXIS = PointMass(0.12, 0.004, (0.0, 0.006, 0.002))
STREAM = Current((0.1, 0.0, 0.05), density=1000.0, coefficient=1.1)
LOADED = {
    "silicone, a mass off the axis": Scene.silicone(*WATER, OFF_AXIS),
    "the paper's tendons in a stream": Scene(Extension(), *WATER, STREAM),
}


def sets(count: int, seed: int) -> Array:
    """Return tensions (count, 12) that bend and roll up the arm of table 4."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 0.5, (count, 12)) * np.repeat([0.3, 2.0, 6.0], 4)


@needs_compiler
@pytest.mark.parametrize("name", LOADED)
def test_many_sets_under_loads_are_those_settled_alone(name: str) -> None:
    arm, scene, T = Arm.from_paper("table-4"), LOADED[name], sets(11, 3)
    many = settle_many(arm, T, scene, compile=True)
    for i, row in enumerate(T):
        alone = settle(arm, row, scene)
        assert many.tip[i] == pytest.approx(alone.tip, abs=1e-11)
        assert many.tip_frame[i] == pytest.approx(alone.tip_frame, abs=1e-10)
        assert many.error[i] == pytest.approx(alone.error, rel=1e-2, abs=1e-11)


BALL = Contact(Sphere((0.2, -0.05, 0.0), 0.032))


@pytest.mark.parametrize("effect", [BALL, SelfContact()], ids=lambda each: type(each).__name__)
def test_sets_in_contact_are_those_settled_alone(effect: Effect) -> None:
    scene, T = Scene(Extension(), ExactTendons(), effect), np.zeros((2, 4))
    T[1, 0] = 0.3
    many = settle_many(SHORT, T, scene, 1e-4)
    alone = [settle(SHORT, row, scene, 1e-4) for row in T]
    assert np.array_equal(many.tip, [shape.tip for shape in alone])
    assert [len(shape.contacts) > 0 for shape in alone] == [False, effect is BALL]


@pytest.mark.slow
@needs_compiler
def test_what_buckles_is_refused_as_it_is_alone() -> None:
    arm, scene = Arm.from_paper("section-5.2"), Scene(TipLoad((-0.5, 0.0, 0.0)))
    T = np.zeros((3, arm.n_tendons))
    T[[0, 2], 1] = 0.3
    with pytest.raises(SnapError) as refused:
        settle(arm, T[1], scene)
    many = settle_many(arm, T, scene, compile=True, errors="nan")
    assert many.problems == ("", str(refused.value), "")
    assert np.isnan(many.tip).all(axis=1).tolist() == [False, True, False]


ARM, SHORT = Arm.from_paper("table-4"), Arm.from_paper("section-5.2")
GOOD = np.array([[0, 0, 0.3, 0, 1.0, 0, 0, 0, 0, 2.0, 0, 0], [0.1] * 12, [0.0] * 12])
CRUSHING = np.full(12, 1e3)
WITH_ERRORS = [
    Scene(Extension()),
    Scene(Extension(), ExactTendons()),
    Scene.silicone(),
    Scene(Extension(), Weight(), Buoyancy()),
]


def check(arm: Arm, scene: Scene, sets: Any, bad: dict[int, str]) -> None:
    """Check that bad rows are nan and tell why, and good ones are as by themselves."""
    many = settle_many(arm, sets, scene, 1e-5, errors="nan")
    good = [i for i in range(len(sets)) if i not in bad]
    alone = settle_many(arm, [sets[i] for i in good], scene, 1e-5)
    assert many.tip[good] == pytest.approx(alone.tip, abs=1e-12)
    assert many.tip_frame[good] == pytest.approx(alone.tip_frame, abs=1e-12)
    assert alone.problems == ("",) * len(good)
    assert not np.isnan(many.error[good]).any()
    for i, told in bad.items():
        assert told in many.problems[i]
        assert np.isnan(many.tip[i]).all() and np.isnan(many.tip_frame[i]).all()
        assert np.isnan(many.error[i]) and np.isnan(many.tensions[i]).all()
    assert [i for i, told in enumerate(many.problems) if told] == sorted(bad)


@pytest.mark.parametrize("scene", WITH_ERRORS, ids=lambda scene: f"{len(scene.effects)} effects")
def test_bad_rows_do_not_lose_the_others(scene: Scene) -> None:
    sets = [GOOD[0], CRUSHING, GOOD[1], [1.0, 2.0], GOOD[2], -GOOD[0]]
    bad = {3: "tensions[3]: got", 5: "tensions[5]"}
    # A neo-Hookean body is not crushed by any tension.
    crushed = {} if scene == Scene.silicone() else {1: "the arm"}
    check(ARM, scene, sets, bad | crushed)


def test_the_given_array_stays_as_it_was() -> None:
    sets = np.array([GOOD[0], CRUSHING])
    before = sets.copy()
    many = settle_many(ARM, sets, Scene(Extension()), 1e-5, errors="nan")
    assert "tensions[1]: the arm is crushed" in many.problems[1]
    assert np.array_equal(sets, before)


def test_sets_of_lengths_too() -> None:
    from model.winches import rest_lengths

    scene = Scene(Extension(), ExactTendons())
    rest = rest_lengths(ARM)
    sets = [rest - 1e-3, rest * np.nan, rest]
    many = settle_many(ARM, None, scene, 1e-5, lengths=sets, errors="nan")
    assert many.problems[0] == many.problems[2] == ""
    assert "lengths[1]" in many.problems[1]
    assert np.isnan(many.tip[1]).all() and np.isfinite(many.tip[[0, 2]]).all()
