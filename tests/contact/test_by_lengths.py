"""An arm that leans on a rod, tendons held by winches: what tensions do, complementarity."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Contact, ExactTendons, Extension
from model.obstacles import Capsule
from tests.contact.cases import bar
from tests.lengths.cases import check_complementary

ROD = Capsule((0.2, -0.1, -0.07), (0.2, 0.1, -0.07), 0.05)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return bar(0.3, 0.006, 2e5)


def test_lengths_of_a_leaning_arm_give_it_back(arm: Arm) -> None:
    T = np.array([0.0, 0.3, 0.1, 0.0])
    given = settle(arm, T, SCENE, 1e-8)
    assert given.contacts
    lengths = given.tendon_lengths + 1e-3 * (T == 0)
    back = settle(arm, scene=SCENE, accuracy=1e-8, lengths=lengths)
    check_complementary(back)
    assert back.tensions == pytest.approx(T, abs=1e-5)
    assert back.tip == pytest.approx(given.tip, abs=1e-7 * arm.length)
    wanted = np.sum([touch.force for touch in given.contacts], axis=0)
    assert np.sum([touch.force for touch in back.contacts], axis=0) == pytest.approx(
        wanted, abs=1e-5
    )


def test_a_rod_makes_a_winch_pull_harder(arm: Arm) -> None:
    """The same stroke takes more tension where the arm cannot bend as it would."""
    free = settle(arm, [0.0, 0.3, 0.0, 0.0], Scene(Extension(), ExactTendons()), 1e-8)
    lengths = free.tendon_lengths + np.array([1e-2, 0.0, 1e-2, 1e-2])
    leaning = settle(arm, scene=SCENE, accuracy=1e-8, lengths=lengths)
    assert leaning.contacts
    assert leaning.tensions[1] > 0.3 + 1e-3
    check_complementary(leaning)
