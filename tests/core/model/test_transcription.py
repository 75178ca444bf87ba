"""The transcription by collocation: order, derivatives, structure, and verification."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.verification import verify
from octoplan.model.extensions.friction import Friction
from octoplan.model.rod.discrete_rod import DiscreteRod, system
from octoplan.model.support.errors import ConvergenceError
from tests.core.planner.cases import moderate
from tests.differences import Array, check_rows, fourth_order

ARM, PULLS = Arm.from_paper("table-4"), np.ravel(moderate())
WATER: tuple[Effect, ...] = (Weight(), Buoyancy())
STREAM = (Current((0.0, 0.05, 0.02)), TipLoad((0.0, 1e-3, 0.0), follower=True))
SCENES = {
    "paper in water": Scene(Extension(), *WATER),
    "silicone in water": Scene(*Scene.silicone().effects, *WATER),
    "stream": Scene(Extension(), Shear(), *WATER, *STREAM),
    "point load": Scene(Extension(), ExactTendons(), PointLoad(0.1, (0.0, 2e-3, 0.0))),
    "rough": Scene(Extension(), *WATER, Friction(0.2)),
}
EVERYTHING = Scene(*Scene.silicone().effects, *WATER, *STREAM, Shear(), Friction(0.1))


@pytest.mark.quick("silicone in water-1", "silicone in water-3")
@pytest.mark.parametrize("stages", [1, 2, 3])
@pytest.mark.parametrize("name", ["paper in water", "silicone in water", "stream", "point load"])
def test_the_error_of_the_tip_falls_with_twice_the_number_of_stages(name: str, stages: int) -> None:
    def tip(stages: int, refinement: int) -> Array:
        return CollocationMap(system(ARM, SCENES[name], stages, refinement)).solve(PULLS).poses[-1]

    best = tip(3, 32)
    gaps = np.array([tip(stages, refinement) - best for refinement in (2, 4, 8)])
    for part in (gaps[:, :4], gaps[:, 4:] / ARM.length):
        errors = np.linalg.norm(part, axis=1)
        assert errors[-1] > 1e-12
        jacobian = np.log2(errors[:-1] / errors[1:])
        assert jacobian.min() > 2 * stages - 0.4
        assert jacobian.max() < 2 * stages + 0.4


def somewhere(here: DiscreteRod, seed: int) -> Array:
    """Return unknowns of a bent arm off its equilibrium."""
    rng, law = np.random.default_rng(seed), here.layout.structure.law
    v = 3.0 * rng.normal(size=here.layout.stages.shape)
    v[:, 3] = law.along_at_rest + 0.02 * v[:, 3]
    v[:, 4:] *= 0.02
    T = rng.uniform(0.1, 0.5, here.layout.n_tendons)
    states = here.initial_states(T, v, 1.0)
    return here.x(T, 0.9, states * (1 + 1e-2 * rng.normal(size=states.size)))


@pytest.mark.quick("silicone in water-section-5.2", "point load-table-2", "everything-table-2")
@pytest.mark.parametrize("name", ["section-5.2", "table-2"])
@pytest.mark.parametrize("scene", [*SCENES.values(), EVERYTHING], ids=[*SCENES, "everything"])
def test_derivatives_of_the_equations_are_those_of_differences(name: str, scene: Scene) -> None:
    arm = Arm.from_paper(name)
    here = system(arm, scene, 2, 1)
    of, x = here.layout.equations, somewhere(here, 1)
    rng = np.random.default_rng(2)
    # Ways in proportion to the unknowns, whose units differ; and the same for Hessians' rows.
    size = np.where(x == 0, 1e-3, np.abs(x))
    way, lam = size * rng.normal(size=x.size), rng.normal(size=here.layout.n_states)

    def jacobian(x: Array) -> Array:
        nonzeros = of.jacobian.function(x, here.p)
        return np.array(ca.densify(ca.DM(of.jacobian.places, nonzeros)))[:, :-1]

    nonzeros = of.hessian.function(x, here.p, lam)
    H = np.array(ca.densify(ca.DM(of.hessian.places, nonzeros)))
    check_rows(jacobian(x), way, fourth_order(lambda share: here.residual(x + share * way), 1e-4))
    wanted = fourth_order(lambda share: jacobian(x + share * way).T @ lam, 1e-4)
    check_rows(size[:, None] * H * size, way / size, size * wanted)
    assert np.array_equal(H, H.T)


@pytest.mark.quick("bare-section-5.2", "stream-section-5.2", "rough-section-5.2")
@pytest.mark.parametrize("arm", ["table-4", "section-5.2"])
@pytest.mark.parametrize("name", ["bare", *SCENES])
def test_what_verifies_an_equilibrium_corrects_a_coarse_one(name: str, arm: str) -> None:
    scene, given = SCENES.get(name, Scene()), Arm.from_paper(arm)
    pulls = {"table-4": PULLS, "section-5.2": np.array([0.3, 0.2, 0.0, 0.1])}[arm]
    # A coarse mesh, with an error of some millionths of the length.
    here = CollocationMap(system(given, scene, 2, 2)).solve(pulls)
    corrected, error = verify(here, 1e-8)
    wanted = settle(given, pulls, scene, 1e-10).tip
    coarse, fine = (at.system.poses(at.states)[-1, 4:] for at in (here, corrected))
    assert error <= 1e-8
    assert np.linalg.norm(coarse - wanted) > 5e-7 * given.length
    assert np.linalg.norm(fine - coarse) > 5e-7 * given.length
    assert np.linalg.norm(fine - wanted) < 1e-7 * given.length
    with pytest.raises(ConvergenceError, match="rk8"):
        verify(here, 1e-17)


def test_an_arm_that_is_all_but_crushed_is_integrated() -> None:
    """Strains change faster along the arm than any polynomial through the stages of an element."""
    arm, scene = Arm.from_paper("table-4"), Scene(Extension(), ExactTendons())
    T = np.array([0.306, 0.335, 0.66, 0.343, 0.015, 4.82, 5.377, 0.075, 2.965, 0, 0, 2.958])
    collocation = CollocationMap(system(arm, scene, 3, 16, (), False))
    here = collocation.solve(T)
    corrected, error = verify(here, 1e-6)
    assert error <= 1e-6
    assert corrected.poses[-1, 4:] == pytest.approx(here.poses[-1, 4:], abs=1e-3 * arm.length)
