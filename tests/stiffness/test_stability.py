"""Sections that are at no minimum of their energy: when that is so, and when it cannot be."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Scene, settle
from model.effects import TipLoad
from model.errors import OctoplanError
from model.statics import loaded_statics_of
from model.stations import stations
from planner import stiffness
from tests.model.cases import MOST
from tests.stiffness.cases import STATICS, with_effects

# Two tendons against each other, outside of the body, held by discs.
R, Y = 6e-3, 7.8e-3
ANTAGONISTS = Arm(
    0.3, Linear(R, R), (Anchorage(0.3, Linear(Y, Y), (0.0, np.pi)),), hull=Linear(9e-3, 9e-3)
)
EA = ANTAGONISTS.material.E * np.pi * R**2


@pytest.mark.parametrize("loaded", [False, True], ids=["unloaded", "loaded"])
@pytest.mark.parametrize(
    ("scene", "stretch"),
    [(name, x) for name in ("silicone", "anticlastic") for x in (0.9, 0.7, 0.65, 0.55)],
)
def test_swelling_that_takes_tendons_inwards_makes_the_straight_arm_unstable(
    scene: str, stretch: float, loaded: bool
) -> None:
    # E A / 3 (lambda - lambda^-2) = -2 T, and d(moment) / d(curvature) in the tendons' plane.
    pull = EA / 6 * (stretch**-2 - stretch)
    bending = EA * R**2 / 4 * (1 + 2 * stretch**-3) / (3 * stretch)
    bending -= (scene == "anticlastic") * pull * Y**2 / stretch**2
    effects = (TipLoad(),) if loaded else ()
    k = stiffness(ANTAGONISTS, [pull, pull], with_effects(STATICS[scene], *effects))
    assert 1 + k.shape.strain(0.1)[3] == pytest.approx(stretch, rel=1e-9)
    assert k.section(0.1)[1] == pytest.approx(bending, rel=1e-9)
    assert k.stable == (bending > 0)
    assert bending > 0 or (scene == "anticlastic" and stretch < 0.7)


def least_eigenvalue(arm: Arm, T: Any, scene: Scene) -> float:
    """The least eigenvalue of d(wrench) / d(strain), over E J and E A of the section, anywhere."""
    statics = loaded_statics_of(scene, arm)
    v, e = ca.SX.sym("v", statics.size), ca.SX.sym("e", 4)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    slopes = ca.Function("K", [v, pull, data], [ca.jacobian(statics.wrench(v, pull, data), v)])
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], 0, 0)
    state = ca.Function("state", [e], [statics.state(kappa, nu)])
    shape = settle(arm, T, scene, 1e-4)
    found = []
    for s in np.linspace(0.0, arm.length, 9):
        active = np.array([sum(section.at >= s for section in arm.sections)])
        at = stations(arm, np.array([s]), active)
        body = at.body[:, 0]
        size = np.sqrt([body[1]] * 3 + [body[0]] * (statics.size - 3))
        maps, numbers = statics.pulls(arm, at)[0][0], statics.data(at)[0]
        K = np.array(slopes(state(shape.strain(s)), maps @ shape.tensions, numbers))
        found.append(np.linalg.eigvalsh((K + K.T) / 2 / np.outer(size, size))[0])
    return float(min(found))


@pytest.mark.parametrize("scene", ["bare", "paper", "exact"])
@pytest.mark.parametrize("name", ["table-2", "table-4"])
def test_a_linear_body_only_gains_stiffness_from_its_tendons(name: str, scene: str) -> None:
    # 1/(1 + nu) = 2/3 is the body's own G I / E J.
    rng, arm = np.random.default_rng(0), Arm.from_paper(name)
    for _ in range(12):
        T = rng.uniform(size=(3, 4)) * np.array(MOST[name])[:, None] * 10 ** rng.uniform(-1, 0.5)
        try:
            assert least_eigenvalue(arm, T, STATICS[scene]) > 2 / 3 - 1e-9
        except OctoplanError:
            continue
        assert stiffness(arm, T, STATICS[scene], accuracy=1e-4).stable
