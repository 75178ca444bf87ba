"""Every scheme converges at its order."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Extension
from model.forward import equilibrium_on, forward_map, order_of, schemes_of
from model.unloaded.marched import Marched
from tests.oracles import Array

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
    pytest.param(arm, scene, scheme, id=f"{arm}-{key}-{scheme}")
    for arm in TENSIONS
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
    forward = forward_map(Arm.from_paper(name), scene, scheme, refinement)
    found = equilibrium_on(forward, TENSIONS[name])
    return found.rows if isinstance(found, Marched) else found.poses


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


@pytest.mark.parametrize("scheme", ORDERS)
def test_a_forward_map_states_its_order(scheme: str) -> None:
    scene = Scene.as_printed() if scheme.startswith("rk") else Scene()
    assert order_of(scheme, scene) == ORDERS[scheme]
