"""Arms that may touch something come to the same of several shapes as free arms."""

from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Sphere

FAR = Contact(Sphere((0.0, 5.0, 0.0), 0.1))
UP = ((0, 1, 0), (0, 0, 1), (1, 0, 0))
# Two stable shapes of the arm of table 4 in air, by what acts first.
BISTABLE = [0, 0.01, 0, 0, 0.09, 0, 0, 0, 11.42, 0, 11.31, 6.86]


def test_an_arm_beside_an_obstacle_bears_its_loads_first_as_a_free_arm_does() -> None:
    arm, scene = Arm.from_paper("table-4"), Scene(Extension(), ExactTendons(), Weight())
    free, beside = (settle(arm, BISTABLE, each, 1e-5) for each in (scene, scene + FAR))
    assert free.history == beside.history == "loads first"
    assert not beside.snaps
    assert beside.tip == pytest.approx(free.tip, abs=2e-5 * arm.length)


def test_antagonists_hold_an_upright_arm_beside_an_obstacle_too() -> None:
    """Without tension the arm buckles under its loads."""
    arm = replace(Arm.from_paper("table-2"), base_frame=UP)
    scene = Scene.silicone(Weight(g=(0, 0, -3.0)))
    free, beside = (settle(arm, np.full((3, 4), 1.0), each, 1e-5) for each in (scene, scene + FAR))
    assert free.history == "tensions first"
    assert not beside.snaps
    assert beside.tip == pytest.approx(free.tip, abs=2e-5 * arm.length)


def test_a_shape_near_another_has_its_own_history() -> None:
    arm, scene = Arm.from_paper("table-4"), Scene(Extension(), ExactTendons(), Weight(), FAR)
    first = settle(arm, np.full((3, 4), 0.1), scene, 1e-5)
    near = settle(arm, np.full((3, 4), 0.11), scene, 1e-5, near=first)
    assert (first.history, near.history) == ("loads first", "near")
