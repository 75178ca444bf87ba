"""A sweep of one point equals the function itself, to the last bit, in random scenes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, OctoplanError, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.contact.effects import Contact, SelfContact
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.support.errors import FileError
from octoplan.planner import plan, stiffness, sweep
from octoplan.planner.targets import TipPosition

ARM = Arm.from_paper("table-2")


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a scene of one of the statics and up to two further effects."""
    scene = [Scene(), Scene(Extension()), Scene(Extension(), ExactTendons()), Scene.silicone()][
        rng.integers(4)
    ]
    small = rng.uniform(-2e-3, 2e-3, 3)
    free = settle(ARM, _tensions(rng), scene).position(0.6 * ARM.length)
    ball = Sphere(tuple(free + rng.uniform(-0.02, 0.02, 3)), 0.01)
    more: list[tuple[Effect, ...]] = [
        (Weight(), Buoyancy()),
        (Weight(), Buoyancy(), PointMass(0.1, 1e-3, (0.0, 5e-3, 0.0))),
        (TipLoad(tuple(small), (0.0, 0.0, 1e-5), bool(rng.integers(2))),),
        (PointLoad(0.12, tuple(small)),),
        (Current((0.0, 0.05, 0.02)),),
        (Shear(0.9),),
        (Friction(0.1, tuple(rng.choice([-1, 1], ARM.n_tendons).tolist())),),
        (Contact(ball),),
        (SelfContact(),),
    ]
    for i in rng.permutation(len(more))[: rng.integers(1, 3)]:
        try:
            scene = Scene(*scene.effects, *more[i])
        except InputError:
            continue
    return scene


def _tensions(rng: np.random.Generator) -> Any:
    T = rng.uniform(0, 0.6, ARM.n_tendons) * (rng.uniform(size=ARM.n_tendons) < 0.4)
    return ARM.by_section(T)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.quick("3", "5", "17")
def test_a_sweep_of_one_point_is_a_settle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, T = random_scene(rng), _tensions(rng)
    found = sweep(ARM, scene=scene, tensions=T, axes={"arm.nu": [0.5]}, progress=False)
    try:
        alone = settle(ARM, T, scene)
    except OctoplanError as reason:
        assert str(reason)[:40] in str(found.outcome.values[0])
        return
    assert found.settled.values.all(), found.outcome.values
    # Results differed in the last digit of one arbitrary number in fifty, due to millimetres.
    assert np.array_equal(found.tip.values[0], alone.tip)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
def test_a_sweep_of_one_point_is_a_stiffness(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, T = random_scene(rng), _tensions(rng)
    given: dict[str, Any] = {"tensions": T, "compute": "stiffness", "progress": False}
    try:
        found = sweep(ARM, scene=scene, axes={"arm.nu": [0.5]}, **given)
    except FileError as refused:  # before anything runs, by name
        with pytest.raises(InputError, match=re.escape(refused.problem.rpartition(": ")[2][-40:])):
            stiffness(ARM, T, scene)
        return
    try:
        alone = stiffness(ARM, T, scene)
        compliance = alone.compliance
    except OctoplanError as reason:
        assert str(reason)[:40] in str(found.outcome.values[0])
        return
    assert bool(found.stable.values[0]) == alone.stable
    assert np.array_equal(found.compliance.values[0], compliance)


@pytest.mark.parametrize("seed", range(200, 220))
@pytest.mark.quick("201")
def test_a_sweep_of_one_point_is_a_plan(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    target = TipPosition(tuple(settle(ARM, _tensions(rng), Scene.silicone()).tip.tolist()))
    given: dict[str, Any] = {"tension_max": 4.0, "accuracy": 1e-5, "progress": False}
    try:
        alone = plan(ARM, target, scene, **given)
    except OctoplanError as reason:
        told = str(reason)[:40]
        try:
            found = sweep(ARM, scene=scene, target=target, axes={"arm.nu": [0.5]}, **given)
        except FileError as refused:  # before anything runs, by name
            assert str(reason).partition(" = ")[0] in refused.problem
        else:
            assert told in str(found.outcome.values[0])
        return
    found = sweep(ARM, scene=scene, target=target, axes={"arm.nu": [0.5]}, **given)
    assert found.outcome.values[0] == alone.outcome
    assert np.array_equal(found.tensions.values[0], np.ravel(alone.tensions))
