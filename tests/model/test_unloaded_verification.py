"""Integration from the base makes of an arm without loads what closed forms settle it to."""

import numpy as np
import pytest

from model import Arm, ConvergenceError, Scene, settle
from model.centreline import Centreline
from model.effects import ExactTendons, Extension
from model.rotations import matrices
from model.unloaded.verification import integrated

ARM = Arm.from_paper("table-4")
T = np.array([0, 0, 0.3, 0.1, 1.0, 0, 0, 0.5, 0, 2.0, 0, 1.0])
SCENES = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_poses_midline_and_stability_are_those_of_the_settled_shape(scene: Scene) -> None:
    stations = (0.1, ARM.length)
    found, shape = integrated(ARM, scene, T, stations, 1e-9, 3, False), settle(ARM, T, scene, 1e-11)
    assert found.error <= 1e-9
    places = [found.mesh.node(s) for s in stations]
    assert found.poses[places, 4:] == pytest.approx(shape.position(np.array(stations)), abs=1e-9)
    frames = matrices(found.poses[places, :4])
    assert frames == pytest.approx(shape.frame(np.array(stations)), abs=1e-8)
    assert found.stability == pytest.approx(shape.stability, rel=0.03)
    line, s = found.centreline(), np.linspace(0.01, 0.99 * ARM.length, 7)
    assert isinstance(line, Centreline)
    places_between, _ = line.at(s)
    assert places_between == pytest.approx(shape.position(s), abs=1e-6)


def test_steps_that_do_not_come_to_an_accuracy_are_refused() -> None:
    with pytest.raises(ConvergenceError, match="rk8"):
        integrated(ARM, Scene(Extension()), T, (ARM.length,), 1e-17, 3, False)
