"""All schemes of a scene: names, orders, frames, and one and the same shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.effects import Extension, Weight
from octoplan.model.forward import check_scheme, maps_of, schemes_of
from octoplan.model.unloaded.marched import Marched
from tests.effects.cases import RODS, fem_arm, fem_cases, name_of
from tests.oracles import Array

PAPER = Scene(Extension())
ALL = schemes_of(PAPER)
FINE = [scheme for scheme in ALL if not scheme.endswith("2")]
Case = dict[str, Any]
BENT = [case for case in fem_cases() if name_of(case) in ("a 0.05", "b 2")]


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


ORDERS = {
    "magnus2": 2,
    "magnus4": 4,
    "magnus6": 6,
    "gauss2": 2,
    "gauss4": 4,
    "gauss6": 6,
    "gauss8": 8,
    "rk4": 4,
    "rk6": 6,
    "rk8": 8,
}
SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}
TENSIONS = {
    "table-2": np.array([0, 0.5, 0.8, 0, 1, 0, 0, 0.5, 0, 0, 2, 1]),
    "table-4": np.array([0, 0.1, 0.2, 0, 1, 0, 0, 0.5, 0, 0, 2, 1]),
}
EACH = [
    pytest.param(arm, scene, scheme, id=f"{arm}-{key}-{scheme}", marks=marks)
    for arm, marks in zip(TENSIONS, ([], [pytest.mark.slow]), strict=True)
    for key, scene in SCENES.items()
    for scheme in schemes_of(scene)
]
# All others take their strains from the balance of each cross-section, without error.
STRAINED = [case for case in EACH if str(case.values[2]).startswith("rk")]


def jacobian(errors: list[float]) -> Array:
    """Return the orders that errors on meshes of halved steps show."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def meshes(name: str, scheme: str) -> tuple[int, ...]:
    """Return refinements where the error is asymptotic and well above rounding."""
    if scheme in ("rk8", "gauss8"):
        return (2, 4) if name == "table-2" else (8, 16)
    coarsest = (2 if name == "table-2" else 4) * (2 if scheme.startswith("rk") else 1)
    return coarsest, 2 * coarsest, 4 * coarsest


def node_states(name: str, scene: Scene, scheme: str, refinement: int) -> Array:
    forward = maps_of(Arm.from_paper(name), scene, scheme, False).on(refinement)
    found = forward.solve(TENSIONS[name])
    if not isinstance(found, Marched) or not scheme.startswith("rk"):
        return found.poses
    # Strains on the base side of the nodes, from the tip on, and last at the base.
    rows = found.strains[[-1, *range(found.mesh.steps)[::-1]], :3]
    return np.hstack([found.poses, rows])


@pytest.mark.parametrize(("name", "scene", "scheme"), EACH)
def test_tip_error_falls_at_the_order_of_the_scheme(name: str, scene: Scene, scheme: str) -> None:
    wanted = node_states(name, scene, schemes_of(scene)[0], 128)[-1, 4:7]
    errors = [
        float(np.linalg.norm(node_states(name, scene, scheme, n)[-1, 4:7] - wanted))
        for n in meshes(name, scheme)
    ]
    assert np.all(np.abs(jacobian(errors) - ORDERS[scheme]) <= 0.3)


@pytest.mark.parametrize(("name", "scene", "scheme"), STRAINED)
def test_strain_error_falls_at_the_order_of_the_scheme(
    name: str, scene: Scene, scheme: str
) -> None:
    wanted = node_states(name, scene, "rk6", 256)[0, 7:]
    errors = [
        float(np.linalg.norm(node_states(name, scene, scheme, n)[0, 7:] - wanted))
        for n in meshes(name, scheme)
    ]
    assert np.all(np.abs(jacobian(errors) - ORDERS[scheme]) <= 0.3)


def test_every_scheme_of_a_scene_is_measured() -> None:
    assert {*schemes_of(Scene()), *schemes_of(Scene.as_printed())} == set(ORDERS)
