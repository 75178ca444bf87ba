"""The order at which errors fall, and one shape by closed form, collocation and another code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.explicit import ClosedForm, ExplicitEquilibrium
from octoplan.model.equilibrium.runge_kutta import RK8, RungeKutta
from octoplan.model.extensions.printed import RK6, PrintedMap
from octoplan.model.forward import ForwardMap
from octoplan.model.rod.collocation import MAGNUS4, MAGNUS6, Magnus
from octoplan.model.rod.discrete_rod import system
from tests.collocation import collocated
from tests.core.effects.cases import RODS, fem_arm, fem_cases, name_of
from tests.oracles import Array

Case = dict[str, Any]
Build = Callable[[Arm, Scene, int], ForwardMap]
BENT = [case for case in fem_cases() if name_of(case) in ("a 0.05", "b 2")]


@pytest.mark.parametrize("way", [lambda *of: settle(*of, accuracy=1e-8), collocated])
@pytest.mark.parametrize("rod", ["exact", "nh", "nha"])
@pytest.mark.parametrize("case", BENT, ids=name_of)
def test_rubber_settles_to_an_independent_rod_code(case: Case, rod: str, way: Any) -> None:
    arm, T = fem_arm(case)
    tip = way(arm, T, RODS[rod]).tip
    assert np.linalg.norm(tip[:2] - case["rods"][rod]["tip"]) < 1e-6


def closed_form(scheme: Magnus) -> Build:
    return lambda arm, scene, refinement: ClosedForm(arm, scene, scheme, refinement)


def collocation(stages: int) -> Build:
    return lambda arm, scene, refinement: CollocationMap(
        system(arm, scene, stages, refinement, (), False)
    )


def printed(scheme: RungeKutta) -> Build:
    return lambda arm, scene, refinement: PrintedMap(arm, scene, scheme, refinement)


# Order of convergence and forward map, by name.
MAPS: dict[str, tuple[int, Build]] = {
    "magnus4": (4, closed_form(MAGNUS4)),
    "magnus6": (6, closed_form(MAGNUS6)),
    **{f"gauss{2 * stages}": (2 * stages, collocation(stages)) for stages in (1, 2, 3, 4)},
}
PRINTED: dict[str, tuple[int, Build]] = {"rk6": (6, printed(RK6)), "rk8": (8, printed(RK8))}
SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}
TENSIONS = {
    "table-2": np.array([0, 0.5, 0.8, 0, 1, 0, 0, 0.5, 0, 0, 2, 1]),
    "table-4": np.array([0, 0.1, 0.2, 0, 1, 0, 0, 0.5, 0, 0, 2, 1]),
}
EACH = [
    pytest.param(arm, key, name, id=f"{arm}-{key}-{name}", marks=marks)
    for arm, marks in zip(TENSIONS, ([], [pytest.mark.slow]), strict=True)
    for key in SCENES
    for name in (PRINTED if key == "as_printed" else MAPS)
]
# Other schemes take strains from the balance of each cross-section, without error.
STRAINED = [case for case in EACH if case.values[1] == "as_printed"]


def orders(errors: list[float]) -> Array:
    """Return the orders that errors on meshes of halved steps show."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def meshes(arm: str, name: str) -> tuple[int, ...]:
    """Return refinements at which the error is asymptotic and well above rounding."""
    if name in ("rk8", "gauss8"):
        return (2, 4) if arm == "table-2" else (8, 16)
    coarsest = (2 if arm == "table-2" else 4) * (2 if name in PRINTED else 1)
    return coarsest, 2 * coarsest, 4 * coarsest


def node_states(arm: str, key: str, build: Build, refinement: int) -> Array:
    found = build(Arm.from_paper(arm), SCENES[key], refinement).solve(TENSIONS[arm])
    if not isinstance(found, ExplicitEquilibrium) or key != "as_printed":
        return found.poses
    # Strains on the base side of the nodes, from the tip on, and last at the base.
    rows = found.strains[[-1, *range(found.mesh.elements)[::-1]], :3]
    return np.hstack([found.poses, rows])


@pytest.mark.parametrize(("arm", "key", "name"), EACH)
def test_tip_error_falls_at_the_order_of_the_map(arm: str, key: str, name: str) -> None:
    finest = PRINTED["rk6"] if key == "as_printed" else MAPS["magnus6"]
    order, build = (MAPS | PRINTED)[name]
    wanted = node_states(arm, key, finest[1], 128)[-1, 4:7]
    errors = [
        float(np.linalg.norm(node_states(arm, key, build, n)[-1, 4:7] - wanted))
        for n in meshes(arm, name)
    ]
    assert np.all(np.abs(orders(errors) - order) <= 0.3)


@pytest.mark.parametrize(("arm", "key", "name"), STRAINED)
def test_strain_error_falls_at_the_order_of_the_map(arm: str, key: str, name: str) -> None:
    order, build = PRINTED[name]
    wanted = node_states(arm, key, PRINTED["rk6"][1], 256)[0, 7:]
    errors = [
        float(np.linalg.norm(node_states(arm, key, build, n)[0, 7:] - wanted))
        for n in meshes(arm, name)
    ]
    assert np.all(np.abs(orders(errors) - order) <= 0.3)
