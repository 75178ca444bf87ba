"""The Jacobian of the tip, against differences of settled shapes."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Sampled, Scene, settle, tip_jacobian
from octoplan.model.effects import ExactTendons, Extension, Weight
from tests.oracles import Array

TABLE4 = Arm.from_paper("table-4")
SPACING = np.linspace(0, 0.2, 7)
BARREL = Sampled(tuple(SPACING), tuple(4e-3 + 1e-3 * np.sin(SPACING * 12)))
SAMPLED = Arm(0.3, Linear(9e-3, 5e-3), (Anchorage(0.2, BARREL, (0.3, 2.0)),))
UNEVEN = Arm(
    0.4,
    Linear(9e-3, 2e-3),
    (
        Anchorage(0.38, Linear(6e-3, 1e-3), (0.0, 2.1, 4.2)),
        Anchorage(0.2, Linear(7e-3, 3e-3), (1.0,)),
        Anchorage(0.01, Linear(5e-3, 8e-3), (2.0, 5.0)),
    ),
)
ARMS = {"table 4": TABLE4, "sampled": SAMPLED, "uneven": UNEVEN}
SCENES = {
    "bare": Scene(),
    "extension": Scene(Extension()),
    "as printed": Scene.as_printed(),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
    "weight": Scene(Extension(), Weight(g=(0, 0, -0.3))),
}


def differences(arm: Arm, T: Array, scene: Scene) -> Array:
    """Displacement and turn of the tip per newton, by central differences of fourth order."""
    columns = []
    for j in range(T.size):
        h = 2e-3 * (0.1 + T[j])

        def moved(share: float, j: int = j, h: float = h) -> tuple[Array, Array]:
            shape = settle(arm, T + share * h * np.eye(T.size)[j], scene, 1e-12)
            return shape.tip, shape.tip_frame

        weights = {1.0: 8, -1.0: -8, 2.0: -1, -2.0: 1}
        tip = sum(w * moved(k)[0] for k, w in weights.items()) / (12 * h)
        frame = sum(w * moved(k)[1] for k, w in weights.items()) / (12 * h)
        spin = frame @ moved(0.0)[1].T
        columns.append(np.concatenate([tip, [spin[2, 1], spin[0, 2], spin[1, 0]]]))
    return np.array(columns).T


@pytest.mark.quick(
    "sampled-bare", "sampled-extension", "sampled-silicone", "uneven-as printed", "uneven-exact"
)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("arm", ARMS)
def test_jacobian_is_what_differences_tend_to(arm: str, scene: str) -> None:
    body = ARMS[arm]
    T = np.random.default_rng(3).uniform(0.02, 0.3, body.n_tendons)
    found = tip_jacobian(body, T, SCENES[scene], accuracy=1e-9)
    wanted = differences(body, T, SCENES[scene])
    size = np.repeat([body.length, 1.0], 3)[:, None]
    assert np.abs((found - wanted) / size).max() <= 1e-6 * np.abs(wanted / size).max()


@pytest.mark.parametrize("scene", ["bare", "extension", "silicone"])
def test_jacobian_of_an_arm_at_rest_is_finite(scene: str) -> None:
    found = tip_jacobian(TABLE4, np.zeros(12), SCENES[scene])
    assert np.all(np.isfinite(found))
    assert np.abs(found).max() > 0
