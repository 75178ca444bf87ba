"""The tip error that a shape states, against the one it has."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, ConvergenceError, Scene, settle
from model.effects import ExactTendons, Extension
from model.equilibrium.newton import STAGES, Collocation
from model.equilibrium.stability import stability
from model.equilibrium.verification import Verified, verified
from model.forward import equilibrium_on, forward_map, schemes_of
from model.rotations import matrices
from tests.model.cases import MOST, paper_tensions

SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}
SETS = 100


def test_stated_errors_are_as_fine_as_asked_bound_the_true_ones_and_are_not_far_above() -> None:
    """Random tensions on both arms to random accuracies; the truth is the finest mesh."""
    asked, stated, true = np.zeros((3, SETS))
    for seed in range(SETS):
        rng = np.random.default_rng(seed)
        name, scene = str(rng.choice(list(MOST))), SCENES[str(rng.choice(list(SCENES)))]
        arm, T = Arm.from_paper(name), paper_tensions(rng, name)
        asked[seed] = 10 ** rng.uniform(-9, -3)
        shape = settle(arm, T, scene, float(asked[seed]))
        finest = equilibrium_on(forward_map(arm, scene, schemes_of(scene)[0], 256), T).poses[-1, 4:]
        stated[seed], true[seed] = shape.error, np.linalg.norm(shape.tip - finest) / arm.length
    assert (true <= asked).sum() >= 0.99 * SETS
    assert (true <= stated).sum() >= 0.99 * SETS
    assert np.all((stated > 0) & (stated <= asked))
    assert np.median(stated / true) < 10
    # They take meshes of many sizes.
    assert true.min() < 1e-10 and true.max() > 1e-6


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
