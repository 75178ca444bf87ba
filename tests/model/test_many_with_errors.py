"""One bad set of many is a row of nan with its reason; the others are as if it were not there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model import Arm, CollapsedError, Scene, settle_many
from model.effects import Buoyancy, ExactTendons, Extension, Weight

ARM = Arm.from_paper("table-4")
GOOD = np.array([[0, 0, 0.3, 0, 1.0, 0, 0, 0, 0, 2.0, 0, 0], [0.1] * 12, [0.0] * 12])
CRUSHING = np.full(12, 1e3)
SCENES = [
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


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: f"{len(scene.effects)} effects")
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


def test_loads_that_an_arm_does_not_bear_are_a_row() -> None:
    upright = Scene(Weight((-9.81, 0.0, 0.0)))
    slender = Arm.from_paper("section-5.2")
    many = settle_many(slender, np.zeros((1, 4)), upright, 1e-4, errors="nan")
    assert all("does not bear its loads" in told for told in many.problems)


def test_sets_of_lengths_too() -> None:
    from model.winches import rest_lengths

    scene = Scene(Extension(), ExactTendons())
    rest = rest_lengths(ARM)
    sets = [rest - 1e-3, rest * np.nan, rest]
    many = settle_many(ARM, None, scene, 1e-5, lengths=sets, errors="nan")
    assert many.problems[0] == many.problems[2] == ""
    assert "lengths[1]" in many.problems[1]
    assert np.isnan(many.tip[1]).all() and np.isfinite(many.tip[[0, 2]]).all()


def test_without_it_the_first_error_is_raised() -> None:
    with pytest.raises(CollapsedError, match=r"tensions\[1\]"):
        settle_many(ARM, [GOOD[0], CRUSHING], Scene(Extension()), 1e-5)
