"""Shapes of a fit settle as `settle` does, on coarse meshes and on the way to other values."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad, Weight
from octoplan.planner import Measured, Unknown, calibrate
from tests.calibrate.cases import small_arm


def loaded(force: tuple[float, ...]) -> Scene:
    return Scene(Extension(), ExactTendons(), TipLoad(force=force))


# Coarse meshes were refused as crushed (1, 24), or as jumping (2, 25), from both initial guesses.
@pytest.mark.parametrize(
    "seed",
    [1, 2, 24, 25]
    + [pytest.param(k, marks=pytest.mark.slow) for k in range(40) if k not in (1, 2, 24, 25)],
)
def test_three_forces_are_recovered_from_a_tip_that_settles(seed: int) -> None:
    arm, rng = Arm.from_paper("table-4"), np.random.default_rng(seed)
    T, force = rng.uniform(0, 1.5, 12), rng.uniform(-5e-4, 5e-4, 3)
    shape: Any = settle(arm, T, loaded(tuple(force.tolist())), 1e-8)
    unknowns = [Unknown(f"effects.tip_load.force[{k}]", -2e-3, 2e-3) for k in range(3)]
    for begin in ((0.0, 0.0, 0.0), tuple(force.tolist())):
        measured = [Measured(T, tip=shape.tip, std=1e-4)]
        found = calibrate(arm, loaded(begin), measured, unknowns)
        assert not found.left_out
        # The meshes of a fit are accurate to 1e-5 of the length.
        assert found.array == pytest.approx(force, abs=1e-6)


def test_a_fit_is_not_refused_at_the_limit_of_its_shape() -> None:
    """The tip calls for a modulus at which the tensions crush the arm."""
    scene = Scene(Extension(), Weight())
    stiff = replace(small_arm(), material=Material(220e3, 0.45, 1100.0))
    strong = Measured([12.0, 12.0, 12.0], tip=(0.0, 0.0, -0.02), name="strong", std=1e-3)
    found = calibrate(stiff, scene, [strong], [Unknown("arm.E_kPa", 50, 300)])
    assert found.blocked[0][0] == "strong"
    assert "The fit ended where strong ceases to settle: the arm is crushed" in found.outcome
    limit = replace(stiff, material=Material(1e3 * found.values[0], 0.45, 1100.0))
    assert settle(limit, strong.tensions, scene).equilibrium.extremes.stretch == pytest.approx(
        0.0, abs=1e-3
    )


def test_lengths_without_markers_on_meshes_of_any_kind() -> None:
    """Shapes by lengths settle from the shape of `settle`, carried to the mesh of the fit."""
    arm, rng = Arm.from_paper("table-4"), np.random.default_rng(702)
    T = rng.uniform(0, 1.0, 12) * (rng.random(12) < 0.5)
    force = (1e-4, -1e-4, 5e-5)
    shape: Any = settle(arm, T, loaded(force), 1e-8)
    unknowns = [Unknown(f"effects.tip_load.force[{k}]", -2e-3, 2e-3) for k in range(3)]
    measured = [Measured(lengths=shape.tendon_lengths, tip=shape.tip)]
    found = calibrate(arm, loaded((0.0, 0.0, 0.0)), measured, unknowns)
    assert found.array == pytest.approx(force, abs=1e-6)
