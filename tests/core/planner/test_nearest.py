"""The nearest shape of a missed target, against independent grids of settled shapes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle, settle_many
from octoplan.model.effects import ExactTendons, Extension, Shear, Weight
from octoplan.model.paths import Array
from octoplan.planner import plan
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solve.multistart import solve_from_guess
from octoplan.planner.solve.samples import fitted, sample, spread
from octoplan.planner.solve.search import N_SAMPLED
from octoplan.planner.targets import TipPosition

STRAIGHT = Linear(0.0, 0.0)
HELICAL = Arm(
    0.2,
    Linear(3e-3, 3e-3),
    (
        Anchorage(
            0.2,
            Linear(8e-3, 8e-3),
            (1.571, -0.524, -2.618, -2.618),
            turn=(STRAIGHT, STRAIGHT, STRAIGHT, Linear(0.0, -9.425)),
        ),
    ),
    Material(E=1.1e6, nu=0.3, density=1000.0),
    base_frame=((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    hull=Linear(0.015, 0.015),
)
SHEAR, MAXIMA = Scene(Extension(), ExactTendons(), Shear()), (0.118, 0.118, 0.118, 0.204)
PLACE = (-0.01, -0.005, 0.04)
THIN = Arm(
    0.7,
    Linear(5e-3, 3e-3),
    (Anchorage(0.7, Linear(4e-3, 2.5e-3), (0.3, 2.4, 4.5)),),
    Material(E=300e3, nu=0.45, density=1100.0),
)
EXACT = Scene(Extension(), ExactTendons())


def _problem(
    arm: Arm, place: tuple[float, ...], scene: Scene, maxima: tuple[float, ...]
) -> PlanningProblem:
    limits, target = TendonLimits.of(arm, np.array(maxima)), TipPosition(place)  # type: ignore[arg-type]
    return PlanningProblem(arm, (target,), scene, limits, NlpOptions(), 1e-6)


def _least_of_grid(
    arm: Arm, place: tuple[float, ...], scene: Scene, maxima: tuple[float, ...], levels: int
) -> float:
    shares = product(np.linspace(0.0, 1.0, levels), repeat=arm.n_tendons)
    tips = settle_many(arm, np.array(list(shares)) * maxima, scene, 1e-4).tip
    return float(np.linalg.norm(tips - place, axis=1).min())


def test_nearest_tip_of_a_helical_arm_is_as_near_as_a_grid() -> None:
    """The mesh ignored the turn of the tendon: 146 mm, but a corner of the limits has 102 mm."""
    found = plan(HELICAL, TipPosition(PLACE), SHEAR, MAXIMA)
    off = float(np.linalg.norm(found.tip - PLACE))
    corner = settle(HELICAL, [0, 0.118, 0.118, 0.204], SHEAR)
    assert off <= np.linalg.norm(corner.tip - PLACE) + 1e-6
    assert off <= _least_of_grid(HELICAL, PLACE, SHEAR, MAXIMA, 3) + 1e-6
    assert "the nearest shape found misses the tip position by 102 mm" in found.outcome
    assert (
        f"{len(found.solution.starts)} initial guesses and {found.solution.sampled} sampled shapes"
        in found.outcome
    )
    assert found.solution.sampled > 100


@pytest.mark.slow
@pytest.mark.parametrize("place", [(-0.1, 0.2, 0.1), (0.05, -0.12, 0.0)])
def test_nearest_tip_of_a_curled_thin_arm_is_as_near_as_a_grid(
    place: tuple[float, float, float],
) -> None:
    """Two elements have an error of 40 % of the length if the arm curls by more than a turn."""
    maxima = (0.35, 0.35, 0.35)
    found = plan(THIN, TipPosition(place), EXACT, maxima)
    off = float(np.linalg.norm(found.tip - place))
    assert off <= 1.01 * _least_of_grid(THIN, place, EXACT, maxima, 6) + 1e-6


def test_the_nearest_of_similar_shapes_is_chosen_on_the_fine_mesh() -> None:
    """On the coarse mesh, the shape of the limit of 5 N was 1 % nearer than the nearest one."""
    section = Anchorage(0.3, Linear(7e-3, 3e-3), (0.0,))
    arm = Arm(0.3, Linear(0.01, 0.005), (section,), Material(E=1e5, nu=0.45, density=1080.0))
    place = (0.1, 0.1, 0.1)
    found = plan(arm, TipPosition(place), Scene(Extension()), 5.0)
    off = float(np.linalg.norm(found.tip - place))
    assert off <= _least_of_grid(arm, place, Scene(Extension()), (5.0,), 101)
    assert float(found.tensions.max()) == pytest.approx(2.971, abs=1e-3)


def test_the_search_mesh_resolves_tendons_that_turn() -> None:
    problem = _problem(HELICAL, PLACE, SHEAR, MAXIMA)
    forward = ProgramInstance(problem, problem.coarse("nearest")).forward
    for T in ([0, 0.118, 0.118, 0.204], [0.1, 0, 0.05, 0.2]):
        tip = settle(HELICAL, T, SHEAR, 1e-8).tip
        on_mesh = forward.solve(np.array(T, dtype=float)).poses[-1, 4:]
        assert np.linalg.norm(on_mesh - tip) < 1e-3 * HELICAL.length


@pytest.mark.slow
def test_the_search_mesh_is_finer_where_samples_curl() -> None:
    problem = _problem(THIN, (0.01, 0.0, 0.02), EXACT, (1.5, 1.5, 1.5))
    samples = sample(problem, N_SAMPLED)
    mesh = samples.problem.coarse("nearest").refinement
    assert mesh > problem.coarse("nearest").refinement
    forward = ProgramInstance(samples.problem, samples.problem.coarse("nearest")).forward
    nearest = samples.tensions[0]
    tip = settle(THIN, nearest, EXACT, 1e-8).tip
    assert np.linalg.norm(forward.solve(nearest).poses[-1, 4:] - tip) < 1e-2 * THIN.length


@pytest.mark.slow
def test_nearest_solves_converge_from_all_corners_of_the_limits() -> None:
    """No optimum is farther off than the corner that the solver started from."""
    problem = _problem(HELICAL, PLACE, SHEAR, MAXIMA)
    instance = ProgramInstance(problem, problem.coarse("nearest"))
    for corner in product((0.0, 1.0), repeat=4):
        T = np.array(MAXIMA) * corner
        end = solve_from_guess(instance, T)
        assert end.converged, corner
        start = instance.forward.solve(T).poses[-1, 4:] - PLACE
        assert np.sqrt(2 * end.f) * HELICAL.length <= np.linalg.norm(start) + 1e-4


def test_samples_cover_corners_and_keep_to_the_limits() -> None:
    problem = _problem(HELICAL, PLACE, SHEAR, MAXIMA)
    T = spread(problem, 192)
    assert T.shape == (192, 4)
    assert T.min() >= 0 and (np.array(MAXIMA) - T).min() >= 0
    corners = {tuple(corner) for corner in (T / np.array(MAXIMA)).tolist()}
    assert corners >= set(product((0.0, 1.0), repeat=4))
    total = replace(problem, limits=replace(problem.limits, lower=(0.01,) * 4, total=0.2))
    T = spread(total, 192)
    assert (T.sum(axis=1) <= 0.2 * (1 + 1e-12)).all() and (T >= 0.01 - 1e-15).all()


@pytest.mark.slow
def test_samples_come_by_the_distance_of_their_settled_tips() -> None:
    samples = sample(_problem(HELICAL, PLACE, SHEAR, MAXIMA), N_SAMPLED)
    tips = [settle(HELICAL, T, SHEAR, 1e-4).tip for T in samples.tensions[::20]]
    off = np.linalg.norm(np.array(tips) - PLACE, axis=1)
    assert (np.diff(off) > -1e-3 * HELICAL.length).all()
    assert np.sqrt(2 * samples.objective[::20]) * HELICAL.length == pytest.approx(off, rel=1e-2)


@pytest.mark.parametrize("scene", [EXACT, Scene(Extension(), Weight())])
def test_fits_move_samples_onto_the_target(scene: Scene) -> None:
    tip = settle(THIN, [0.1, 0.03, 0.0], scene).tip
    problem = _problem(THIN, tuple(tip.tolist()), scene, (0.35, 0.35, 0.35))
    near: Array = np.array([[0.07, 0.05, 0.0], [0.2, 0.1, 0.1], [0.12, 0.0, 0.02]])
    T, misses = fitted(replace(problem, mesh=4), near)
    assert (T >= 0).all() and (T <= 0.35).all()
    assert misses.min() < 1e-4
    shape = settle(THIN, T[misses.argmin()], scene)
    assert np.linalg.norm(shape.tip - tip) < 1e-3 * THIN.length


@pytest.mark.slow
def test_agreement_alone_does_not_end_a_search_that_misses() -> None:
    """Guesses agreed on the nearest shape before a shape across the limits was tried."""
    far = plan(THIN, TipPosition((0.9, 0.0, 0.1)), EXACT, 0.35)
    assert not far.reached
    assert len(far.solution.starts) > N_SAMPLED and far.solution.sampled > 100
    few = plan(THIN, TipPosition((0.9, 0.0, 0.1)), EXACT, 0.35, starts=4)
    assert len(few.solution.starts) <= 4
    met = plan(THIN, TipPosition(tuple(settle(THIN, [0.1, 0.03, 0], EXACT).tip)), EXACT, 0.35)
    assert met.reached and met.solution.sampled == 0 and "sampled" not in met.outcome
