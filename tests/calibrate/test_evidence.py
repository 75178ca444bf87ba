"""Standard errors and intervals of fits with few data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy

from octoplan.model import Arm, InputError, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.planner import Measured, Unknown, calibrate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.targets import TipPosition
from tests.calibrate.cases import HANGING, PULLS, small_arm

STRAIGHT = Scene(Extension(), ExactTendons(), TipLoad(force=(0.0, 0.0, 0.0)))
T = np.array([0.3, 0.0, 0.1, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.8, 0.2])
FORCES = [Unknown(f"effects.tip_load.force[{k}]", -2e-3, 2e-3) for k in range(3)]
WIDE_FORCES = [replace(force, lower=-2e-2, upper=2e-2) for force in FORCES]
E = Unknown("arm.E_kPa", 50, 300)
DENSITY = Unknown("arm.density", 300, 2500)


def loaded(force: Any) -> Scene:
    return Scene(Extension(), ExactTendons(), TipLoad(force=tuple(np.asarray(force).tolist())))


def three_forces(std: float | None, **options: Any) -> Calibration:
    """Three tip forces from one tip, 0.5 mm off."""
    arm = Arm.from_paper("table-4")
    tip: Any = np.add(settle(arm, T, loaded([2e-4, -1e-4, 3e-4])).tip, [5e-4, -5e-4, 5e-4])
    return calibrate(arm, STRAIGHT, [Measured(T, tip=tip, std=std)], FORCES, **options)


@pytest.fixture(scope="module")
def given() -> Calibration:
    return three_forces(1e-3)


def test_without_surplus_data_given_deviations_hold(given: Calibration) -> None:
    """Return standard errors by the inverse of the linear map from forces to the tip."""
    assert given.degrees_of_freedom == 0
    assert given.noise == 1.0
    columns = []
    for k in range(3):
        step = 1e-5 * (np.arange(3) == k)
        ends = [
            settle(given.given_arm, T, loaded(given.array + side * step), 1e-9).tip
            for side in (-1, 1)
        ]
        columns.append((ends[1] - ends[0]) / 2e-5)
    inverse = np.linalg.inv(np.transpose(columns))
    assert given.covariance == pytest.approx(1e-6 * inverse @ inverse.T, rel=1e-3)
    assert given.interval()[:, 1] - given.array == pytest.approx(1.95996 * given.std, rel=1e-4)
    assert np.all(np.abs(given.array - [2e-4, -1e-4, 3e-4]) < 3 * given.std)
    absolute = three_forces(1e-3, absolute_std=True)
    assert given.std == pytest.approx(absolute.std, rel=1e-6)


def test_predictions_without_surplus_data_are_as_unsure(given: Calibration) -> None:
    sure = given.predict(T)
    assert sure.std == pytest.approx(1e-6 * np.eye(3), rel=1e-3, abs=1e-9)
    assert sure.model_error == pytest.approx([1e-3], rel=1e-3)
    assert sure.band() == pytest.approx(1.95996 * np.sqrt(2) * 1e-3 * np.ones((1, 3)), rel=1e-3)
    planned: Any = given.plan(TipPosition(tuple(sure.tip.tolist())), tension_max=2.0)
    assert planned.tip_std > 1e-4
    assert "no surplus data" in planned.outcome
    assert "no surplus data" in given.outcome


def test_next_shapes_shrink_errors_without_surplus_data(given: Calibration) -> None:
    (again,) = given.next([T])
    # The same shape once more halves the variance.
    assert again.shrink == pytest.approx([np.sqrt(0.5)] * 3, rel=0.01)


def test_errors_are_unknown_without_surplus_data_and_deviations() -> None:
    found = three_forces(None)
    assert np.all(np.isinf(found.std))
    assert np.all(np.isinf(found.interval()))
    assert "Standard errors are unknown" in found.outcome
    assert found.unidentified == ()
    sure = found.predict(T)
    assert np.isinf(sure.tip_std)
    assert np.all(np.isinf(sure.band()))
    assert sure.holds([sure.tip + 1.0]).all()
    planned = found.plan(TipPosition(tuple(sure.tip.tolist())), tension_max=2.0)
    assert "Standard errors are unknown" in planned.outcome


def test_absolute_deviations_have_to_be_given() -> None:
    with pytest.raises(InputError, match="absolute_std"):
        three_forces(None, absolute_std=True)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_errors_of_few_surplus_data_are_those_of_scipy(count: int) -> None:
    """Fit by curve_fit over `settle`, with deviations scaled by the residuals, and Student's t."""
    arm, rng = small_arm(), np.random.default_rng(count)
    scene = Scene(*HANGING.effects, TipLoad(force=(0.0, 0.0, 0.0)))
    # Places of one marker and the tip: six numbers.
    unknowns = [E, *WIDE_FORCES, DENSITY][: 6 - count]
    shape = settle(arm, PULLS[0], scene, 1e-8)
    place: Any = shape.position(0.1) + 3e-5 * rng.normal(size=3)
    tip: Any = shape.tip + 3e-5 * rng.normal(size=3)
    points: Any = [(0.1, (0.0, 0.0, 0.0), place)]
    measured = Measured(PULLS[0], points, tip=tip)
    found = calibrate(arm, scene, [measured], unknowns, accuracy=1e-7)
    assert found.degrees_of_freedom == count
    assert f"Only {count} surplus number" in found.outcome

    def places(_: object, *values: float) -> np.ndarray:
        _, there, loads = found.parameters.setting(np.array(values))
        at = settle(there, PULLS[0], loads, 1e-9)
        return np.concatenate([at.position(0.1), at.tip])

    data = np.concatenate([place, tip])
    x_scale = np.array([unknown.range for unknown in unknowns])
    values, covariance = scipy.optimize.curve_fit(
        places, None, data, found.array, method="trf", x_scale=x_scale, xtol=1e-12, diff_step=1e-4
    )
    std = np.sqrt(covariance.diagonal())
    assert np.all(np.abs(found.array - values) <= 0.01 * std)
    assert found.std == pytest.approx(std, rel=0.01)
    t = scipy.stats.t(count).ppf(0.975)
    assert found.interval()[:, 1] - found.array == pytest.approx(t * found.std)


class Held(NamedTuple):
    """Whether intervals of 95 % hold the parameters, a predicted tip, and a marker to come."""

    parameters: list[bool]
    tip: list[bool]
    marker: list[bool]


def held_by_few_data(seed: int) -> Held:
    """Draw an arm, its shapes and noise, and fit with none to three surplus numbers."""
    rng, surplus = np.random.default_rng(20261128 + seed), seed % 4
    sigma = 10 ** rng.uniform(-5, -3.7)
    arm = small_arm()
    truth = np.array(
        [rng.uniform(90, 180), *rng.uniform(-3e-3, 3e-3, 3), rng.uniform(900, 1400), 0.0]
    )
    truth[5] = rng.uniform(4.5, 7)
    offset = Unknown("arm.sections[0].offset_mm[0]", 3, 9)
    unknowns = [E, *WIDE_FORCES, DENSITY, offset]
    true_arm = replace(
        arm,
        material=Material(1e3 * truth[0], 0.45, truth[4]),
        sections=(replace(arm.sections[0], offset=Linear(1e-3 * truth[5], 5e-3)),),
    )
    true_scene = Scene(*HANGING.effects, TipLoad(force=tuple(truth[1:4].tolist())))
    # One or two shapes of a tip, or of two markers.
    size = 6 if surplus == 3 else 3 * int(rng.integers(1, 3))
    chosen = rng.permutation(4)[: size - surplus] if size == 3 else np.arange(size - surplus)
    chosen = np.sort(chosen)
    given_arm = replace(
        arm,
        material=Material(
            1e3 * (120.0 if 0 in chosen else truth[0]), 0.45, 1100.0 if 4 in chosen else truth[4]
        ),
        sections=(arm.sections if 5 in chosen else true_arm.sections),
    )
    known = [0.0 if k in chosen else float(truth[k]) for k in (1, 2, 3)]
    scene = Scene(*HANGING.effects, TipLoad(force=tuple(known)))
    # Stated deviations are true without surplus data, and wrong by any factor otherwise.
    told = sigma if not surplus else sigma * 10 ** rng.uniform(-1, 1)
    pulls = rng.uniform(0, 1.5, (size // 3 + 1, 3))
    shapes = []
    for pull in pulls[:-1]:
        place: Any = settle(true_arm, pull, true_scene, 1e-8).tip + sigma * rng.normal(size=3)
        shapes.append(Measured(pull, tip=place, std=told))
    found = calibrate(given_arm, scene, shapes, [unknowns[k] for k in chosen], accuracy=1e-7)
    low, high = found.interval().T
    asked = found.predict(pulls[-1])
    tip = settle(true_arm, pulls[-1], true_scene, 1e-8).tip
    reach = found.quantile(0.95) * np.sqrt(np.diag(asked.std))
    marker = tip + sigma * rng.normal(size=3)
    return Held(
        ((low <= truth[chosen]) & (truth[chosen] <= high)).tolist(),
        (np.abs(asked.tip - tip) <= reach).tolist(),
        (np.abs(asked.places[0] - marker) <= asked.band()[0]).tolist(),
    )


# All but a few intervals of 95 % hold the truth; a few fits by default.
@pytest.mark.parametrize("count", [8, pytest.param(60, marks=pytest.mark.slow, id="all")])
def test_intervals_of_few_data_hold_the_truth(count: int) -> None:
    rows = [held_by_few_data(seed) for seed in range(count)]
    for held in zip(*rows, strict=True):
        share = float(np.mean(np.concatenate(held)))
        assert share >= 0.8 if count < 60 else 0.9 <= share <= 0.99
