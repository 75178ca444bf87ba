"""Effects and scenes are values: which go together, and what they say."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, fields
from itertools import permutations

import numpy as np
import pytest

from model import Arm, OctoplanError, Scene, settle
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)
from planner import plan
from planner.targets import BendingPlane, TipPosition
from tests.effects.cases import EXACT, SILICONE, SWOLLEN

ARM = Arm.from_paper("table-4")


@pytest.mark.quick("silicone")
@pytest.mark.parametrize("scene", [EXACT, SILICONE, SWOLLEN], ids=["exact", "silicone", "shift"])
def test_a_tip_is_planned_and_certified(scene: Scene) -> None:
    T = np.zeros((3, 4))
    T[0, 1], T[1, 2], T[2, 0] = 0.05, 0.8, 1.5
    point = settle(ARM, T, scene, 1e-9).tip
    found = plan(ARM, TipPosition(tuple(point)), scene, 20.0)
    assert found.certificate.passed, found.outcome
    assert np.linalg.norm(found.shape.tip - point) < 1e-6 * ARM.length
    assert found.effort <= np.linalg.norm(T) * (1 + 1e-9)


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


def test_a_bend_of_silicone_is_planned() -> None:
    found = plan(Arm.from_paper("table-2"), BendingPlane(0.4, 1.2, 2), SILICONE, 20.0)
    assert found.certificate.passed, found.outcome


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 30.0])
def test_rubber_settles_or_says_why_not_under_any_pull(scale: float) -> None:
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0], T[2, 1] = 0.5 * scale, 4 * scale, 13 * scale
    try:
        shape = settle(ARM, T, SILICONE, 1e-6)
    except OctoplanError:
        assert scale > 1
    else:
        assert shape.strain(np.linspace(0, 0.45, 50))[:, 3].min() > -1


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
