"""Integration element by element makes of an arm without loads what marches settle it to."""

import numpy as np
import pytest

from model import Arm, ConvergenceError, Scene, settle
from model.effects import ExactTendons, Extension
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.stability import stability
from model.equilibrium.verification import Verified, verified
from model.rotations import matrices

ARM = Arm.from_paper("table-4")
T = np.array([0, 0, 0.3, 0.1, 1.0, 0, 0, 0.5, 0, 2.0, 0, 1.0])
SCENES = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}


def integrated(scene: Scene, stations: tuple[float, ...], accuracy: float) -> Verified:
    """Return the arm as the integrator has it, from a mesh whose tip is off by 1e-5 and more."""
    forward = Collocation(ARM, scene, STAGES, 3, stations, False)
    return verified(forward.found(T), accuracy)


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_poses_and_stability_are_those_of_the_settled_shape(scene: Scene) -> None:
    stations = (0.1, ARM.length)
    found, shape = integrated(scene, stations, 1e-9), settle(ARM, T, scene, 1e-11)
    assert found.error <= 1e-9
    system = found.here.system
    poses = system.poses(found.here.states)[[system.mesh.node(s) for s in stations]]
    assert poses[:, 4:] == pytest.approx(shape.position(np.array(stations)), abs=1e-9)
    frames = matrices(poses[:, :4])
    assert frames == pytest.approx(shape.frame(np.array(stations)), abs=1e-8)
    assert stability(found.here) == pytest.approx(shape.stability, rel=0.03)


def test_steps_that_do_not_come_to_an_accuracy_are_refused() -> None:
    with pytest.raises(ConvergenceError, match="rk8"):
        integrated(Scene(Extension()), (ARM.length,), 1e-17)
