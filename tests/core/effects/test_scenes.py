"""Effects and scenes are values: valid combinations, and their text."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, fields
from itertools import permutations

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.printed import PrintedStatics
from tests.core.effects.cases import EXACT

ARM = Arm.from_paper("table-4")


def test_with_exact_tendons_the_law_of_the_bending_plane_is_nearly_exact() -> None:
    arm, angle = Arm.from_paper("table-2"), np.radians(-30)
    T = np.zeros((3, 4))
    T[0, :2] = 2 * np.array([np.sin(-angle), np.cos(angle)])
    gaps = {}
    for name, scene in (("paper", Scene(Extension())), ("exact", EXACT)):
        tip = settle(arm, T, scene, 1e-9).tip
        gaps[name] = abs(np.degrees(np.arctan2(tip[1], -tip[2]) - angle))
    assert gaps["paper"] == pytest.approx(0.258, abs=1e-3)
    assert gaps["exact"] < 1e-3


FORCE = (0.0, 0.0, -1e-3)
ALL: tuple[tuple[Effect, Effect], ...] = (
    (Buoyancy(), Buoyancy(1025.0)),
    (Current((0.0, 0.1, 0.0)), Current((0.0, 0.1, 0.0), 1025.0)),
    (ExactTendons(), Extension()),
    (Extension(), ExactTendons()),
    (Friction(0.1), Friction(0.1, -1)),
    (NeoHookean(), NeoHookean(True)),
    (PointLoad(0.1, FORCE), PointLoad(0.2, FORCE)),
    (PrintedStatics(), Extension()),
    (Shear(), Shear(5 / 6)),
    (TipLoad(FORCE), TipLoad(FORCE, follower=True)),
    (Weight(), Weight((0.0, -9.81, 0.0))),
)


@pytest.mark.parametrize(("effect", "other"), ALL, ids=[type(one).__name__ for one, _ in ALL])
def test_an_effect_is_a_value(effect: Effect, other: Effect) -> None:
    values = {f.name: getattr(effect, f.name) for f in fields(effect)}
    same = type(effect)(**values)
    assert same == effect and hash(same) == hash(effect) and same is not effect
    assert pickle.loads(pickle.dumps(effect)) == effect
    assert effect != other
    assert len({effect, same, other}) == 2
    assert eval(repr(effect)) == effect
    for name in (*values, "more"):
        with pytest.raises((FrozenInstanceError, AttributeError, TypeError)):
            setattr(effect, name, 0.0)


def test_arrays_and_lists_make_the_same_values_as_tuples_and_may_change_afterwards() -> None:
    force = np.array(FORCE)
    one, other = TipLoad(force), TipLoad([*FORCE])  # type: ignore[arg-type]
    force[:] = 1.0
    assert one == other == TipLoad(FORCE)
    assert Friction(0.1, [1, -1]) == Friction(0.1, (1, -1))  # type: ignore[arg-type]
    assert Weight(np.array([0, 0, -1])) == Weight((0.0, 0.0, -1.0))  # type: ignore[arg-type]


def test_scenes_are_equal_whatever_the_order_of_effects() -> None:
    effects = (
        Extension(),
        Weight(),
        Buoyancy(),
        PointLoad(0.2, FORCE),
        PointLoad(0.1, FORCE),
        TipLoad(FORCE),
    )
    scenes = {Scene(*order) for order in permutations(effects)}
    assert len(scenes) == 1
    assert pickle.loads(pickle.dumps(Scene(*effects))) in scenes


def test_a_scene_is_not_changed() -> None:
    with pytest.raises((FrozenInstanceError, AttributeError)):
        Scene().effects = ()  # type: ignore[misc]
