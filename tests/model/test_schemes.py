"""All schemes of a scene: their names, one and the same shape, and its derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model import InputError, Scene, settle
from model.effects import Extension, Weight
from model.forward import check_scheme, schemes_of
from tests.effects.cases import RODS, fem_arm, fem_cases, name_of
from tests.model.cases import arm_of, mild_tensions, random_rod
from tests.oracles import poses

PAPER = Scene(Extension())
ALL = schemes_of(PAPER)
FINE = [scheme for scheme in ALL if not scheme.endswith("2")]
Case = dict[str, Any]
BENT = [case for case in fem_cases() if name_of(case) in ("a 0.05", "b 2")]


@pytest.mark.quick("0-magnus6", "1-gauss6", "2-magnus4", "3-gauss4")
@pytest.mark.parametrize("scheme", FINE)
@pytest.mark.parametrize("seed", range(4))
def test_any_arm_settles_as_it_is_integrated_independently(scheme: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rod = random_rod(rng)
    T = mild_tensions(rng, rod)
    s = np.linspace(0, rod.length, 6)
    shape = settle(arm_of(rod), T, PAPER, 1e-8, scheme)
    wanted, frames = poses(rod, T, list(s), True)
    assert np.abs(shape.position(s) - wanted).max() <= 1e-8 * rod.length
    assert np.abs(shape.frame(s) - frames).max() <= 1e-6


@pytest.mark.parametrize("scheme", FINE)
@pytest.mark.parametrize("rod", ["exact", "nh", "nha"])
@pytest.mark.parametrize("case", BENT, ids=name_of)
def test_rubber_settles_to_an_independent_rod_code(case: Case, rod: str, scheme: str) -> None:
    arm, T = fem_arm(case)
    tip = settle(arm, T, RODS[rod], 1e-8, scheme).tip
    assert np.linalg.norm(tip[:2] - case["rods"][rod]["tip"]) < 1e-6


@pytest.mark.parametrize("scheme", ["rk6", "magnus6"])
def test_with_loads_only_collocation_is_allowed(scheme: str) -> None:
    scene = Scene(Extension(), Weight())
    assert set(schemes_of(scene)) == {"gauss6", "gauss4", "gauss2", "gauss8"}
    assert check_scheme(scene, None) == "gauss6"
    with pytest.raises(InputError) as caught:
        check_scheme(scene, scheme)
    assert caught.value.allowed.startswith("gauss6, gauss4, gauss2, gauss8 ")


def test_as_printed_strains_are_integrated() -> None:
    assert schemes_of(Scene.as_printed()) == ("rk6", "rk8", "rk4")
    for scheme in ALL:
        with pytest.raises(InputError, match="rk6, rk8, rk4 in this scene"):
            check_scheme(Scene.as_printed(), scheme)
