"""The measured tentacle of SoRoMoX (tests/data/measured_tentacle.json names source and licence)."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Calibration, Unknown, calibrate
from planner.fit.residuals import mean_distance
from tests.calibrate.cases import HANGING, tentacle, tentacle_shapes

UNKNOWNS = [Unknown("arm.E_kPa", 50, 1000), Unknown("arm.density", 500, 2500)]


@pytest.fixture(scope="module")
def found() -> Calibration:
    return calibrate(tentacle(), HANGING, tentacle_shapes(), UNKNOWNS)


def test_modulus_and_density_explain_what_an_independent_program_found(found: Calibration) -> None:
    # 10.7 mm over 22 shapes, of which 18 are here; 15.8 mm published.
    assert found.mean_error == pytest.approx(10.8e-3, abs=0.1e-3)
    assert found.error < 1e-5
    assert found.astray == ()


@pytest.mark.slow
def test_shapes_left_out_are_predicted_and_lie_in_their_bands(found: Calibration) -> None:
    left = found.leave_out()
    assert left.mean_error == pytest.approx(11.1e-3, abs=0.2e-3)
    assert np.mean(left.held) >= 0.9


def test_single_tendons_predict_two(found: Calibration) -> None:
    shapes = tentacle_shapes()
    single = [shape for shape in shapes if min(shape.tensions) == 0]
    both = [shape for shape in shapes if min(shape.tensions) > 0]
    trained = calibrate(found.arm, HANGING, single, UNKNOWNS)
    assert mean_distance(trained.errors(both)) < 11e-3


def test_a_shape_to_come_has_a_band(found: Calibration) -> None:
    point = found.measured[0].points[3]
    asked = found.predict(found.measured[0].tensions, [(point.s, point.offset)])
    miss = next(own for own in found.residuals if own.what == "points[3]")
    assert asked.places[0] - point.place == pytest.approx(miss.miss, abs=1e-6)
    assert asked.holds([point.place]).all()
    assert np.all(asked.band(0.99) > asked.band(0.5))
    assert asked.model_error[0] > 5e-3
