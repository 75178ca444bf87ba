"""Load cells and encoders: shapes by tensions, lengths, or both, each with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, RestCurvature, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.friction import Friction
from octoplan.model.tendons import rest_lengths
from octoplan.planner import Measured, Unknown, calibrate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.experiment import Experiment
from octoplan.planner.extensions.fit.residuals import Evaluation, from_rest
from octoplan.planner.extensions.fit.unknowns import Parameters
from octoplan.planner.targets import TipPosition
from tests.calibrate.cases import HANGING, PULLS, small_arm, synthetic
from tests.differences import fourth_order

E = Unknown("arm.E_kPa", 50, 300)
ANGLE = Unknown("arm.sections[0].angles_deg[0]", -30, 30)


def _off() -> Arm:
    return replace(small_arm(), material=Material(95e3, 0.45, 1100.0))


def _by_length(kind: str, noise: float = 0.0, seed: int = 0) -> list[Measured]:
    """Return shapes of the small arm by encoders, with slack tendons among the tendons."""
    rng, shapes, rest = np.random.default_rng(seed), [], rest_lengths(small_arm())
    for i, T in enumerate([*PULLS, [0.0, 0.0, 0.0]]):
        shape = settle(small_arm(), T, HANGING, 1e-8)
        slack = 2e-3 * (np.array(T) == 0)
        lengths = shape.tendon_lengths + slack + noise * rng.normal(size=3)
        told = {"lengths": lengths} if kind == "lengths" else {"strokes": rest - lengths}
        tip = shape.tip + noise * rng.normal(size=3)
        shapes.append(Measured(tip=tip, name=f"{i}", **told))  # type: ignore[arg-type]
    return shapes


@pytest.mark.quick("strokes")
@pytest.mark.parametrize("kind", ["lengths", "strokes"])
def test_shapes_by_encoders_alone_tell_where_tendons_are(kind: str) -> None:
    true = small_arm()
    turned = replace(true.sections[0], angles=tuple(np.radians([12.0, 120.0, 240.0]).tolist()))
    found = calibrate(
        replace(true, sections=(turned,)), HANGING, _by_length(kind), [ANGLE], accuracy=1e-7
    )
    assert found.values == pytest.approx((0.0,), abs=1e-3)
    assert found.mean_error < 1e-7


def test_a_droop_is_a_shape_without_tensions() -> None:
    level = replace(small_arm(), base_frame=((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))
    droop = Measured([0.0, 0.0, 0.0], tip=settle(level, [0, 0, 0], HANGING, 1e-8).tip)
    off = replace(level, material=Material(150e3, 0.45, 1100.0))
    found = calibrate(off, HANGING, [droop], [E], accuracy=1e-7)
    assert found.values == pytest.approx((120.0,), rel=1e-5)


@pytest.mark.quick("lengths")
@pytest.mark.parametrize("kind", ["tensions", "lengths", "strokes"])
def test_derivatives_of_residuals_are_those_of_differences(kind: str) -> None:
    shapes = _by_length(kind) if kind != "tensions" else synthetic(small_arm(), HANGING, 0.0, 0)
    frames = [(0.15, np.eye(3)[:, [2, 1, 0]] * [-1, 1, 1])]
    shapes = [replace(m, frames=frames) for m in shapes]
    unknowns = [E, ANGLE, Unknown("arm.length_mm", 190, 230), Unknown("arm.density", 500, 2000)]
    found = calibrate(_longer(_off()), HANGING, shapes, unknowns)
    experiment = Experiment(found.parameters, found.measured, 1, 3)
    start = np.array([110.0, 3.0, 210.0, 1000.0])
    here = from_rest(experiment, start)
    J = np.vstack(list(here.jacobians.values()))
    for k, scale in enumerate([10.0, 1.0, 2.0, 50.0]):
        along = scale * np.eye(4)[k]
        wanted = fourth_order(
            lambda x, v=along: _flat(here.near(start + x * v)),
            1e-2,
        )
        assert np.abs(scale * J[:, k] - wanted).max() <= 2e-6 * np.abs(wanted).max()


OUTER = Anchorage(0.2, Linear(0.007, 0.003))
PLAIN = Arm(0.2, Linear(0.01, 0.005), (OUTER, Anchorage(0.09, Linear(0.006, 0.006))))
BENT = replace(
    PLAIN,
    sections=(replace(OUTER, offset=(OUTER.offset,) * 4), PLAIN.sections[1]),
    rest_curvature=RestCurvature(Linear(0.0, 1.0), Linear(-2.0, 1.0)),
)
HELICAL = replace(PLAIN, sections=(replace(OUTER, turn=(Linear(0.0, 0.3),) * 4), PLAIN.sections[1]))
LOADED = Scene.silicone(
    *(Weight(), Buoyancy(800.0), PointLoad(0.15, (0.0, 0.005, 0.0)), TipLoad((0.0, 0.002, 0.001)))
)
RUBBED = Scene(Extension(), ExactTendons(), Weight(), Friction(0.1))
LADEN = Scene(
    *(Extension(), ExactTendons(), Weight((0.0, 0.0, -3.0))),
    PointMass(0.15, 0.005, (0.0, 0.02, -0.01)),
)
EXACT = Scene(Extension(), ExactTendons())
# An arm, a scene, one of their numbers, and a small change of the number.
NUMBERS: dict[str, tuple[Arm, Scene, str, float]] = {
    "modulus": (PLAIN, LOADED, "arm.E_kPa", 0.1),
    "density": (PLAIN, LOADED, "arm.density", 1.0),
    "tip radius": (PLAIN, LOADED, "arm.radius_mm[1]", 5e-3),
    "anchorage": (PLAIN, LOADED, "arm.sections[1].at_mm", 0.09),
    "angle": (PLAIN, LOADED, "arm.sections[1].angles_deg[1]", 0.06),
    "base": (PLAIN, LOADED, "arm.base_position_mm[1]", 0.1),
    "turn of the base": (PLAIN, LOADED, "arm.base_rotation_deg[1]", 0.01),
    "place of a load": (PLAIN, LOADED, "effects.point_loads[0].s_mm", 1.0),
    "tip load": (PLAIN, LOADED, "effects.tip_load.force[0]", 2e-5),
    "rest curvature": (BENT, LOADED, "arm.rest_curvature.n[0]", 1e-3),
    "rest curvature, with friction": (BENT, RUBBED, "arm.rest_curvature.n[0]", 1e-3),
    "rest curvature, no loads": (BENT, Scene(Extension()), "arm.rest_curvature.b[1]", 1e-3),
    "offset of one tendon": (BENT, LOADED, "arm.sections[0].offset_mm[0][0]", 7e-3),
    "offset of one tendon, no loads": (BENT, EXACT, "arm.sections[0].offset_mm[0][0]", 7e-3),
    "turn of one tendon": (HELICAL, LOADED, "arm.sections[0].turn_deg[0][1]", 0.06),
    "a mass": (PLAIN, LADEN, "effects.point_masses[0].mass_g", 0.1),
    "the offset of a mass": (PLAIN, LADEN, "effects.point_masses[0].offset_mm[0]", 1.0),
    "friction": (PLAIN, RUBBED, "effects.friction.mu", 1e-3),
    "anchorage, with friction": (PLAIN, RUBBED, "arm.sections[1].at_mm", 0.09),
    "modulus, no loads": (PLAIN, Scene(Extension()), "arm.E_kPa", 0.1),
    "anchorage, bare": (PLAIN, Scene(), "arm.sections[1].at_mm", 0.09),
}


@pytest.mark.quick("anchorage", "place of a load", "friction", "modulus, no loads")
@pytest.mark.parametrize(("arm", "scene", "key", "step"), NUMBERS.values(), ids=NUMBERS)
def test_shapes_move_with_a_number_as_shapes_settled_afresh_do(
    arm: Arm, scene: Scene, key: str, step: float
) -> None:
    """Position and frame on the way, and the lengths of the tendons."""
    at, there = 0.11, {"frames": [(0.11, np.eye(3))], "lengths": [0.2] * 4 + [0.09] * 4}
    seen = Measured([0.2, 0, 0.1, 0, 0, 0.9, 0, 0], [(at, (0, 0, 0), (at, 0, 0))], **there)  # type: ignore[arg-type]
    (value,) = Parameters.of(arm, scene, [Unknown(key, -1e6, 1e6)]).start
    parameters = Parameters.of(arm, scene, [Unknown(key, value - 10 * step, value + 10 * step)])
    experiment, start = Experiment(parameters, (seen,), 4, 3), parameters.start
    here = from_rest(experiment, start).near(start)
    found = np.vstack(list(here.jacobians.values()))[:, 0]
    wanted = fourth_order(lambda x: _flat(here.near(start + x * step)), 1.0) / step
    assert np.abs(found - wanted).max() <= 1e-6 * np.abs(wanted).max()


def _flat(here: Evaluation) -> np.ndarray:
    return np.concatenate(list(here.residuals.values()))


def _longer(arm: Arm) -> Arm:
    """Return the arm with a tip beyond its anchorage, so that its length may be unknown."""
    return replace(arm, length=0.21)


@pytest.mark.quick("tensions")
@pytest.mark.parametrize("by", ["tensions", "lengths"])
def test_noise_of_what_drives_shapes_is_carried_to_standard_errors(by: str) -> None:
    """Draws of noise of load cells, or encoders, scatter the values as much as stated."""
    values, stds, pulls = [], [], [[1, 0.3, 0.2], [0.2, 1.5, 0.4]]
    for seed in range(12):
        rng = np.random.default_rng(seed)
        if by == "tensions":
            shapes = [
                replace(
                    m, tensions=m.tensions + 0.02 * rng.normal(size=3), std=5e-4, tension_std=0.02
                )
                for m in synthetic(small_arm(), HANGING, 5e-4, seed, pulls)
            ]
            unknowns = [E]
        else:
            shapes = _by_length("lengths", 2e-4, seed)
            shapes = [replace(m, std=2e-4, length_std=2e-4) for m in shapes]
            unknowns = [ANGLE]
        found = calibrate(small_arm(), HANGING, shapes, unknowns, absolute_std=True)
        values.append(found.values[0])
        stds.append(found.std[0])
    assert 0.7 < np.std(values) / np.mean(stds) < 1.4


def test_tensions_and_lengths_together() -> None:
    shape = settle(small_arm(), PULLS[0], HANGING, 1e-8)
    both = Measured(PULLS[0], lengths=shape.tendon_lengths, tension_std=0.1, length_std=1e-4)
    found = calibrate(_off(), HANGING, [both], [E], accuracy=1e-7)
    assert found.values == pytest.approx((120.0,), rel=1e-4)


@pytest.fixture(scope="module")
def sure() -> Calibration:
    density = Unknown("arm.density", 500, 2000)
    return calibrate(_off(), HANGING, synthetic(small_arm(), HANGING, 1e-4, 0), [E, density])


def test_a_predicted_tip_has_the_covariance_of_the_unknowns(sure: Calibration) -> None:
    T = [1.2, 0.4, 0.0]
    told = sure.predict(T)
    assert told.tip == pytest.approx(settle(sure.arm, T, sure.scene, 1e-7).tip, abs=1e-6)

    def tip(values: np.ndarray) -> np.ndarray:
        _, arm, scene = sure.parameters.setting(values)
        return settle(arm, T, scene, 1e-9).tip

    columns = [
        fourth_order(lambda x, v=row: tip(sure.array + x * v), 1e-1) for row in np.diag([1.0, 10.0])
    ]
    J = np.stack(columns, axis=1) / [1.0, 10.0]
    assert told.std == pytest.approx(J @ sure.covariance @ J.T, rel=1e-4, abs=1e-16)
    assert told.tip_std == pytest.approx(np.sqrt(np.trace(told.std)))


def test_points_of_a_prediction_are_where_they_are_said_to_be() -> None:
    """An unknown of the first marker used to displace the first point of a prediction, too."""
    shapes = synthetic(small_arm(), HANGING, 0.0, 0)
    wrong = [
        replace(m, points=[(m.points[0].s, (0.0, 0.0, 0.01), m.points[0].place), *m.points[1:]])
        for m in shapes
    ]
    offset = Unknown("points[0].offset_mm[2]", 5, 40)
    found = calibrate(small_arm(), HANGING, wrong, [offset])
    assert found.values == pytest.approx((20.0,), abs=1e-2)
    shape, at = settle(small_arm(), PULLS[0], HANGING, 1e-8), (0.12, (0.0, 0.0, 0.015))
    there = shape.position(at[0]) + shape.frame(at[0]) @ np.array(at[1])
    assert found.predict(PULLS[0], [at]).places[0] == pytest.approx(there, abs=1e-5)


def test_a_plan_of_a_calibrated_arm_tells_how_sure_its_tip_is(sure: Calibration) -> None:
    tip = tuple(settle(sure.arm, [0.8, 0.2, 0.0], sure.scene).tip.tolist())
    found = sure.plan(TipPosition(tip), tension_max=5.0)
    assert found.certificate.passed
    assert f"tip sure to {1e3 * found.tip_std:.2g} mm (one standard deviation)" in found.outcome
    assert found.tip_std == pytest.approx(sure.predict(found.tensions).tip_std)
    assert found.measured_std > found.tip_std


@pytest.mark.slow
def test_a_shape_that_stops_settling_on_the_way_is_left_out_and_named() -> None:
    """At the given modulus an arm bears tensions that crush the arm at the other modulus."""
    scene = Scene(Extension(), Weight())
    strong = Measured([12.0, 12.0, 12.0], tip=(0.0, 0.0, -0.1), name="strong", std=0.1)
    shapes = synthetic(small_arm(), scene, 1e-5, 0)
    stiff = replace(small_arm(), material=Material(220e3, 0.45, 1100.0))
    found = calibrate(stiff, scene, [*shapes, strong], [E])
    assert found.values == pytest.approx((120.0,), rel=1e-2)
    assert [name for name, _ in found.left_out] == ["strong"]
    assert "strong is left out: the arm is crushed" in found.outcome


def test_the_best_values_so_far_are_returned_at_the_time_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from octoplan.model.support.progress import OutOfTime
    from octoplan.planner.extensions.fit import calibrate as module

    def late(*_: object) -> None:
        raise OutOfTime

    monkeypatch.setattr(module._Search, "_refined", late)
    shapes = synthetic(small_arm(), HANGING, 1e-5, 0)
    found = calibrate(_off(), HANGING, shapes, [E], time_limit=100.0)
    assert found.stopped
    assert "Stopped at the time limit" in found.outcome
    assert found.values == pytest.approx((120.0,), rel=1e-2)


def test_the_figure_shows_arms_residuals_and_standard_errors(sure: Calibration) -> None:
    arms, residuals, errors = sure.plot().axes
    assert len(arms.lines) >= 2 * len(sure.measured)
    assert [tick.get_text() for tick in residuals.get_xticklabels()] == [
        shape.name for shape in sure.measured
    ]
    assert "arm.E_kPa" in errors.get_yticklabels()[0].get_text()


@pytest.mark.parametrize("own", [None, 5e-4])
def test_each_number_has_the_standard_deviation_of_its_kind(own: float | None) -> None:
    place, turned = (0.1, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    given = {"points": [(0.1, (0, 0, 0), place)], "frames": [(0.1, turned)], "tip": place}
    lengths = {"lengths": [0.1, 0.2, 0.3], "std": 2e-3, "angle_std": 0.03, "length_std": own}
    shape = Measured(tensions=[0.0] * 3, **given, **lengths)
    assert shape.stds.tolist() == [2e-3] * 6 + [0.03] * 3 + [own or 2e-3] * 3


def test_unknowns_are_taken_off_the_degrees_of_freedom(sure: Calibration) -> None:
    assert sure.degrees_of_freedom == sum(own.data.size for own in sure.measured) - 2
