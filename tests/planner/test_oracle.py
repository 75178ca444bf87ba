"""Optima of the one program are those of an independent one: SciPy on the tensions alone.

The oracle knows no program of the project's: SLSQP over the tensions with finite differences, the
arm integrated or settled inside of each evaluation.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from model import Arm, Scene, settle
from model.effects import Buoyancy, ExactTendons, Extension, TipLoad, Weight
from planner import plan
from planner.targets import TipPosition
from tests.oracles import Array

ARM, MOST = Arm.from_paper("table-4"), 20.0
SCENES = {
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "follower": Scene(Extension(), TipLoad((0.0, 0.002, 0.0), follower=True)),
}
ORDER = {"2": 2, "1": 1, "inf": np.inf}


def least(scene: Scene, tip: Array, start: Array, norm: str) -> Array:
    """Tensions of least effort near a start, by SLSQP on tensions alone (and the largest)."""

    def effort(z: Array) -> float:
        return {"2": float(z[:12] @ z[:12]) / 2, "1": float(z[:12].sum()), "inf": float(z[12])}[
            norm
        ]

    rows = [
        {
            "type": "eq",
            "fun": lambda z: (settle(ARM, np.clip(z[:12], 0, MOST), scene, 1e-9).tip - tip) / 0.45,
        },
        {"type": "ineq", "fun": lambda z: z[12] - z[:12]},
    ]
    z = minimize(
        effort,
        np.append(start, start.max()),
        bounds=[(0, MOST)] * 13,
        constraints=rows,
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
    ).x
    assert np.linalg.norm(settle(ARM, z[:12], scene, 1e-9).tip - tip) < 1e-6
    return np.asarray(z[:12])


@pytest.mark.quick("paper-2", "water-inf")
@pytest.mark.parametrize("norm", ["2", "1", "inf"])
@pytest.mark.parametrize("name", SCENES)
def test_no_tensions_near_a_plan_meet_its_tip_with_less_effort(name: str, norm: str) -> None:
    scene, rng = SCENES[name], np.random.default_rng(7)
    T = np.array([0, 0.1, 0, 0, 0.4, 0, 0, 0.2, 0, 1.1, 0.3, 0])
    tip = settle(ARM, T, scene, 1e-9).tip
    found = plan(ARM, TipPosition(tuple(tip)), scene, MOST, norm=norm)
    assert found.certificate.passed, found.outcome
    start = np.ravel(found.tensions) + 0.02 * rng.uniform(size=12)
    other = least(scene, tip, np.clip(start, 0, MOST), norm)
    assert found.effort <= np.linalg.norm(other, ORDER[norm]) * (1 + 1e-5)
    assert found.effort == pytest.approx(np.linalg.norm(other, ORDER[norm]), rel=2e-3)
