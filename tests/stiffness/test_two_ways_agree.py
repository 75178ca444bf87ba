"""Without loads, twists of a march answer as the equations of equilibrium do."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import ExactTendons, Extension
from model.equilibrium.sensitivities import Sensitivities
from model.forward import by_collocation, explicit_map
from model.unloaded.march_derivative import MarchDerivative
from model.unloaded.marched import Marched

SCENES = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}
WHAT = ("pose_wrench", "pose_tension", "lengths", "length_wrench", "length_tension")


@pytest.mark.parametrize("at", [0.45, 0.2])
@pytest.mark.parametrize("scene", SCENES)
def test_virtual_work_agrees_with_implicit_functions(scene: str, at: float) -> None:
    arm, T = Arm.from_paper("table-4"), np.zeros(12)
    T[[2, 4, 9]] = 0.2, 1.0, 3.0
    tensions = settle(arm, T, SCENES[scene]).tensions
    gaps = []
    for refinement in (2, 4):
        here = by_collocation(arm, SCENES[scene], 3, refinement, (at,), True).found(tensions)
        node = here.system.mesh.node(at)
        march = explicit_map(arm, SCENES[scene], "magnus6", refinement, (at,))
        ways = (
            Sensitivities(here, node),
            MarchDerivative(Marched.under(march, tensions), march.mesh.node(at)),
        )
        values = [[getattr(way, what) for way in ways] for what in WHAT]
        gaps.append(max(np.abs(a - b).max() / np.abs(a).max() for a, b in values))
        assert ways[0].stable and ways[1].stable
    assert gaps[1] < 1e-4
    assert gaps[1] < gaps[0] / 30  # both of order 6
