"""All schemes of a scene: their names, one and the same shape, and its derivatives."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Arm, InputError, Scene, settle
from model.effects import Extension, Weight
from model.forward import check_scheme, explicit_map, schemes_of
from tests.effects.cases import RODS, fem_arm, fem_cases, name_of
from tests.model.cases import arm_of, mild_tensions, paper_tensions, random_rod
from tests.oracles import Array, poses

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


CASES = [
    pytest.param(scene, scheme, id=f"{key}-{scheme}")
    for key, scene in {"paper": PAPER, "as_printed": Scene.as_printed(), "nh": RODS["nh"]}.items()
    for scheme in schemes_of(scene)
    if not scheme.startswith("gauss")
]


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


def jacobian(function: ca.Function, T: Array) -> Array:
    """Return the Jacobian by central differences of order 6."""
    h, weights = 1e-3, np.array([-1, 9, -45, 45, -9, 1]) / 60
    columns = []
    for direction in np.eye(T.size):
        ends = [np.array(function(T + j * h * direction)) for j in (-3, -2, -1, 1, 2, 3)]
        columns.append(np.tensordot(weights, ends, axes=1).ravel() / h)
    return np.array(columns).T


@pytest.mark.quick("paper-magnus6", "as_printed-rk8", "nh-magnus4", "nh-magnus2")
@pytest.mark.parametrize(("scene", "scheme"), CASES)
def test_the_jacobian_of_the_tip_is_that_of_finite_differences(scene: Scene, scheme: str) -> None:
    forward = explicit_map(Arm.from_paper("table-2"), scene, scheme, 8)
    T = ca.MX.sym("T", 12)
    tip = forward.function(T)[0][:, -1]
    found = ca.Function("found", [T], [ca.jacobian(tip, T)])
    at = 0.2 + 0.3 * paper_tensions(np.random.default_rng(1), "table-2")
    exact, wanted = np.array(found(at)), jacobian(ca.Function("tip", [T], [tip]), at)
    assert np.all(np.isfinite(exact))
    assert np.abs(exact - wanted).max() <= 1e-10 * np.abs(wanted).max()
