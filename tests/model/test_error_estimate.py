"""The tip error that a shape states, against the one it has."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from model import Arm, ConvergenceError, Scene, settle
from model.effects import ExactTendons, Extension
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.stability import stability
from model.equilibrium.verification import Verified, verified
from model.forward import equilibrium_on, forward_map, schemes_of
from model.rotations import matrices
from tests.model.cases import MOST, paper_tensions
from tests.oracles import paper_rod, poses

SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}
SETS = 100


@dataclass(frozen=True)
class Outcome:
    asked: float
    stated: float
    true: float


@lru_cache(maxsize=1)
def outcomes() -> tuple[Outcome, ...]:
    """Settle random tensions on both arms to random accuracies; the truth is the finest mesh."""
    found = []
    for seed in range(SETS):
        rng = np.random.default_rng(seed)
        name, scene = str(rng.choice(list(MOST))), SCENES[str(rng.choice(list(SCENES)))]
        arm, T = Arm.from_paper(name), paper_tensions(rng, name)
        asked = float(10 ** rng.uniform(-9, -3))
        shape = settle(arm, T, scene, asked)
        finest = equilibrium_on(forward_map(arm, scene, schemes_of(scene)[0], 256), T).poses[-1, 4:]
        gap = np.linalg.norm(shape.tip - finest) / arm.length
        found.append(Outcome(asked, shape.error, float(gap)))
    return tuple(found)


def test_tip_is_within_the_accuracy_asked_for() -> None:
    assert sum(x.true <= x.asked for x in outcomes()) >= 0.99 * SETS


def test_stated_error_bounds_the_true_one() -> None:
    assert sum(x.true <= x.stated for x in outcomes()) >= 0.99 * SETS


def test_stated_error_is_no_more_than_what_was_asked_for() -> None:
    assert all(0 < x.stated <= x.asked for x in outcomes())


def test_stated_error_is_not_far_above_the_true_one() -> None:
    assert np.median([x.stated / x.true for x in outcomes()]) < 10


def test_random_cases_need_meshes_of_many_sizes() -> None:
    assert min(x.true for x in outcomes()) < 1e-10
    assert max(x.true for x in outcomes()) > 1e-6


@pytest.mark.parametrize("name", MOST)
def test_finest_mesh_is_as_good_as_an_independent_integration(name: str) -> None:
    T = paper_tensions(np.random.default_rng(5), name)
    rod = paper_rod(name)
    forward = forward_map(Arm.from_paper(name), SCENES["extension"], "magnus6", 256)
    states = equilibrium_on(forward, T).poses
    finest = states[-1, 4:7]
    wanted = poses(rod, T, [rod.length], True)[0][0]
    assert np.linalg.norm(finest - wanted) <= 1e-11 * rod.length


ARM = Arm.from_paper("table-4")
T = np.array([0, 0, 0.3, 0.1, 1.0, 0, 0, 0.5, 0, 2.0, 0, 1.0])
UNLOADED = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}


def integrated(scene: Scene, stations: tuple[float, ...], accuracy: float) -> Verified:
    """Return the arm as the integrator has it, from a mesh whose tip is off by 1e-5 and more."""
    forward = Collocation(ARM, scene, STAGES, 3, stations, False)
    return verified(forward.solve(T), accuracy)


@pytest.mark.parametrize("scene", UNLOADED.values(), ids=UNLOADED)
def test_poses_and_stability_are_those_of_the_settled_shape(scene: Scene) -> None:
    stations = (0.1, ARM.length)
    found, shape = integrated(scene, stations, 1e-9), settle(ARM, T, scene, 1e-11)
    assert found.error <= 1e-9
    system = found.point.system
    poses = system.poses(found.point.states)[[system.mesh.node(s) for s in stations]]
    assert poses[:, 4:] == pytest.approx(shape.position(np.array(stations)), abs=1e-9)
    frames = matrices(poses[:, :4])
    assert frames == pytest.approx(shape.frame(np.array(stations)), abs=1e-8)
    assert stability(found.point) == pytest.approx(shape.stability, rel=0.03)


def test_steps_that_do_not_come_to_an_accuracy_are_refused() -> None:
    with pytest.raises(ConvergenceError, match="rk8"):
        integrated(Scene(Extension()), (ARM.length,), 1e-17)
