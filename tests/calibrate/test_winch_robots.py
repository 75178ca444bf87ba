"""Robots that are driven by winches: zeros, stretch, slack tendons, and orders of tendons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, InputError, Linear, Material, settle
from octoplan.model.extensions.lengths.winches import WinchSettings
from octoplan.model.support.errors import FileError
from octoplan.model.tendons import rest_lengths
from octoplan.planner import Measured, Unknown, calibrate, load_calibration
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.experiment import Experiment
from octoplan.planner.extensions.fit.fitted import parameters_of
from octoplan.planner.extensions.fit.orders import common_orders, section_orders
from octoplan.planner.extensions.fit.residuals import from_rest
from octoplan.planner.frontends.io.csv_files import load_shapes
from octoplan.planner.frontends.io.fit_files import load_asked
from tests.calibrate.cases import HANGING, MARKERS, PULLS, small_arm, synthetic
from tests.differences import fourth_order

ZERO = np.array([1.0, -0.5, 0.6]) * 1e-3
EA = 400.0
OUTSIDE = 0.3
# Strokes in mm; None for slack tendons.
STROKES = (
    (4, None, None),
    (None, 6, 1),
    (2, None, 5),
    (7, 2, None),
    (None, 3, 6),
    (5, 5, None),
    (2, 2, 2),
    (8, None, 1),
)
ZEROS = [Unknown(f"winches.zero_mm[{j}]", -3, 3) for j in range(3)]
STRETCH = Unknown("winches.tendon_EA_N", 50, 5000)
E = Unknown("arm.E_kPa", 50, 300)


@lru_cache(maxsize=1)
def _exact_places() -> tuple[list[np.ndarray], ...]:
    """Return the markers of the small arm on elastic tendons, settled by `settle` alone."""
    arm = small_arm()
    result = []
    for row in STROKES:
        left = rest_lengths(arm) - 1e-3 * np.array(row, dtype=float) - ZERO
        shape = settle(
            arm,
            np.where(np.isnan(left), 0.0, np.nan),
            HANGING,
            1e-8,
            lengths=left,
            tendon_EA=EA,
            tendon_outside=OUTSIDE,
        )
        result.append([shape.position(s) + shape.frame(s) @ np.array(o) for s, o in MARKERS])
    return tuple(result)


def _shapes(noise: float = 0.0, seed: int = 0, kind: str = "strokes") -> list[Measured]:
    """Return shapes with noise of the markers [m]."""
    rng = np.random.default_rng(seed)
    rest = rest_lengths(small_arm())
    shapes = []
    for i, (row, places) in enumerate(zip(STROKES, _exact_places(), strict=True)):
        noisy = [place + noise * rng.normal(size=3) for place in places]
        points = [(s, o, place) for (s, o), place in zip(MARKERS, noisy, strict=True)]
        strokes = 1e-3 * np.array(row, dtype=float)
        # An encoder of lengths shows rest - stroke.
        reading = {"strokes": strokes} if kind == "strokes" else {"lengths": rest - strokes}
        shapes.append(Measured(points=points, name=f"{i}", **reading))  # type: ignore[arg-type]
    return shapes


def _fitted(kind: str) -> Calibration:
    shapes = _shapes(kind=kind)
    unknowns = [*ZEROS, STRETCH]
    options: dict[str, Any] = {"tendon_outside": OUTSIDE, "accuracy": 1e-6}
    return calibrate(small_arm(), HANGING, shapes, unknowns, **options)


@pytest.fixture(scope="module")
def by_strokes() -> Calibration:
    return _fitted("strokes")


def test_zeros_and_stretch_are_recovered(by_strokes: Calibration) -> None:
    assert by_strokes.values == pytest.approx((*(1e3 * ZERO), EA), rel=1e-5)
    assert by_strokes.winches.zero == pytest.approx(ZERO, rel=1e-5)
    assert by_strokes.winches.tendon_EA == by_strokes.values[3]
    assert by_strokes.mean_error < 1e-6
    assert by_strokes.orders == ()


@pytest.mark.slow
def test_zeros_of_encoders_of_lengths_are_the_same(by_strokes: Calibration) -> None:
    assert _fitted("lengths").values == pytest.approx(by_strokes.values, rel=1e-6)


@pytest.mark.quick("few")
@pytest.mark.parametrize(("seeds", "least"), [(2, 6), (24, 84)], ids=["few", "many"])
def test_intervals_of_zeros_hold_the_true_values(seeds: int, least: int) -> None:
    """Of 8 intervals of 95 %, fewer than 6 hold with 0.6 % chance."""
    true = np.array([*(1e3 * ZERO), EA])
    held = 0
    for seed in range(seeds):
        shapes = _shapes(3e-4, seed)
        found = calibrate(small_arm(), HANGING, shapes, [*ZEROS, STRETCH], tendon_outside=OUTSIDE)
        low, high = found.interval().T
        held += int(np.count_nonzero((low <= true) & (true <= high)))
    assert held >= least


def _mixed() -> list[Measured]:
    """Return shapes whose tendons have tensions, strokes or both, or are slack."""
    first, second, *_ = _shapes()
    points = first.points
    return [
        first,
        replace(second, strokes=(None, 0.006, 0.001), std=1e-3, length_std=1e-4),
        Measured((0.4, None, 0.1), points, strokes=(0.003, 0.002, None), tension_std=0.01),
        Measured((0.5, 0.1, 0.0), points, lengths=(0.196, 0.199, None), strokes=(0.003, 0.0, None)),
        Measured((0.3, None, None), lengths=(None, 0.197, 0.2), tip=(0.02, None, -0.19)),
    ]


def _experiment(unknowns: list[Unknown]) -> tuple[Experiment, np.ndarray]:
    shapes = tuple(m.checked(small_arm(), f"{i}") for i, m in enumerate(_mixed()))
    winches = WinchSettings((), EA, OUTSIDE)
    parameters = parameters_of(small_arm(), HANGING, unknowns, shapes, winches)
    return Experiment(parameters, shapes, 2, 3), parameters.start


def test_derivatives_by_winches_are_those_of_differences() -> None:
    unknowns = [
        *ZEROS[:2],
        STRETCH,
        E,
        Unknown("winches.outside_mm", 0, 1000),
        Unknown("tension_scale[0]", 0.5, 2),
    ]
    experiment, start = _experiment(unknowns)
    here = from_rest(experiment, start).near(start)
    assert not here.failed
    J = np.vstack(list(here.jacobians.values()))
    for k, scale in enumerate([0.1, 0.1, 10.0, 5.0, 20.0, 0.02]):
        along = scale * np.eye(len(start))[k]
        wanted = fourth_order(
            lambda x, v=along: np.concatenate([*here.near(start + x * v).residuals.values()]), 1e-2
        )
        assert np.abs(scale * J[:, k] - wanted).max() <= 2e-6 * np.abs(wanted).max()


@pytest.mark.parametrize(
    ("i", "name", "item", "std"), [(1, "strokes", 1, 1e-4), (2, "tensions", 0, 0.01)]
)
def test_noise_of_inputs_is_carried_to_tensions(i: int, name: str, item: int, std: float) -> None:
    """The propagated changes are the ones of shapes settled with changed inputs."""
    experiment, start = _experiment([E])
    shape = experiment.shapes[i]

    def tensions(x: float) -> np.ndarray:
        inputs = list(getattr(shape, name))
        inputs[item] += x * std
        moved = replace(shape, **{name: tuple(inputs)})
        there = Experiment(experiment.parameters, [moved], 2, 3)
        return from_rest(there, start).equilibria[0].tensions

    here = from_rest(experiment, start)
    found = here.drive(i).input_tensions(here.equilibria[i])[:, item]
    # A longer stroke is a shorter length.
    wanted = fourth_order(tensions, 1e-1) * (-1 if name == "strokes" else 1)
    assert found == pytest.approx(wanted, rel=1e-5, abs=1e-9)


def test_each_tendon_is_settled_by_what_is_given() -> None:
    shapes = [m.checked(small_arm(), f"{i}") for i, m in enumerate(_mixed())]
    assert [shape.held for shape in shapes] == [
        (True, False, False),
        (False, True, True),
        (False, True, False),
        (False, False, False),
        (False, True, True),
    ]
    assert shapes[2].tendon_residuals == [("strokes", 0)]
    assert shapes[3].tendon_residuals == [
        *[("lengths", j) for j in (0, 1)],
        ("strokes", 0),
        ("strokes", 1),
    ]
    assert shapes[4].tendon_residuals == []
    nan = float("nan")
    by_nan = Measured([0.4, nan, 0.1], tip=(0, 0, -0.1), strokes=[nan, 0.002, nan], name="1")
    by_none = Measured((0.4, None, 0.1), tip=(0, 0, -0.1), strokes=(None, 0.002, None), name="1")
    assert by_nan.checked(small_arm(), "1") == by_none.checked(small_arm(), "1")


def test_strokes_are_predicted_with_the_zeros_of_the_winches(by_strokes: Calibration) -> None:
    left = rest_lengths(small_arm()) - [0.006, 0.001, np.nan] - ZERO
    stretch: dict[str, Any] = {"tendon_EA": EA, "tendon_outside": OUTSIDE}
    wanted = settle(small_arm(), [np.nan, np.nan, 0.0], HANGING, lengths=left, **stretch)
    found = by_strokes.predict(strokes=[0.006, 0.001, np.nan])
    assert found.tip == pytest.approx(wanted.tip, abs=1e-6)


def test_calibrations_with_winches_are_saved(tmp_path: Path) -> None:
    found = calibrate(small_arm(), HANGING, _shapes(1e-4)[:3], ZEROS[:1], tendon_EA=EA)
    again = load_calibration(found.save(tmp_path / "found.json"))
    assert again == found
    assert again.winches == found.winches
    assert again.winches.tendon_EA == EA
    assert again.measured[0].strokes == (0.004, None, None)


def test_files_have_slack_tendons(tmp_path: Path) -> None:
    columns = [f"stroke_T_1{j}_mm" for j in (1, 2, 3)] + ["tip_x_mm", "tip_z_mm"]
    path = tmp_path / "shapes.csv"
    path.write_text(";".join(columns) + "\n4,5;;nan;12,5;-190\n1;2;3;0;-190\n")
    first, second = load_shapes(path, small_arm())
    assert first.strokes == (0.0045, None, None)
    assert first.held == (True, False, False)
    assert second.strokes == (0.001, 0.002, 0.003)
    path.write_text(path.read_text().replace("4,5;;nan", ";;"))
    with pytest.raises(FileError, match=r"line 2.*tensions, or else with lengths or strokes"):
        load_shapes(path, small_arm())


def _mirrored(measured: Measured, order: tuple[int, ...]) -> Measured:
    return measured.checked(small_arm(), measured.name).reordered(order)


def test_calibration_files_have_stretch(tmp_path: Path) -> None:
    scene = "arm.length_mm = 200\narm.radius_mm = [10, 9]\n"
    scene += "arm.sections = [{ at_mm = 200, offset_mm = [6, 5] }]\n"
    (tmp_path / "scene.toml").write_text(scene)
    columns = [f"stroke_T_1{j}_mm" for j in (1, 2, 3, 4)] + ["tip_x_mm"]
    (tmp_path / "shapes.csv").write_text(",".join(columns) + "\n4,,,,190\n")
    path = tmp_path / "calibration.toml"
    path.write_text(
        'scene = "scene.toml"\nmeasured = "shapes.csv"\ntendon_EA = 400\ntendon_outside_mm = 300\n'
        '[[unknowns]]\nkey = "winches.zero_mm[0]"\nlower = -3\nupper = 3\n'
    )
    given = load_asked(path)
    assert given["tendon_EA"] == EA
    assert given["tendon_outside"] == OUTSIDE
    assert given["starts"] is None
    assert given["measured"][0].strokes == (0.004, None, None, None)
    assert given["unknowns"] == [ZEROS[0]]


@pytest.mark.quick("mirrored")
@pytest.mark.parametrize("order", [(0, 2, 1), (1, 2, 0)], ids=["mirrored", "shifted"])
def test_a_wrong_order_of_tendons_is_found_and_reported(order: tuple[int, ...]) -> None:
    shapes = [_mirrored(m, order) for m in synthetic(small_arm(), HANGING, 3e-4, 0)]
    off = replace(small_arm(), material=Material(95e3, 0.45, 1100.0))
    found = calibrate(off, HANGING, shapes, [E])
    best = found.orders[0].tendons
    assert [order[j] for j in best] == [0, 1, 2]  # the order that undoes the given one
    assert found.values == pytest.approx((120.0,), rel=0.02)
    assert found.mean_error < 1e-3
    assert found.measured[1].tensions == tuple(PULLS[1])
    names = [small_arm().tendon_names[j] for j in best]
    assert f"{', '.join(names)} as T_11, T_12, T_13" in found.outcome
    assert "check the wiring" in found.outcome
    assert len(found.orders) == 6


def test_wrong_orders_of_winches_are_found_and_saved(tmp_path: Path) -> None:
    shapes = [_mirrored(m, (0, 2, 1)) for m in _shapes(3e-4)[:4]]
    found = calibrate(small_arm(), HANGING, shapes, ZEROS, tendon_EA=EA, tendon_outside=OUTSIDE)
    assert found.orders[0].tendons == (0, 2, 1)
    assert found.values == pytest.approx(1e3 * ZERO, abs=0.5)
    assert load_calibration(found.save(tmp_path / "found.json")) == found


def test_a_bad_fit_in_every_order_keeps_the_given_one() -> None:
    shapes = synthetic(small_arm(), HANGING, 0.02, 0)
    found = calibrate(small_arm(), HANGING, shapes, [E])
    assert found.orders[0].tendons == (0, 1, 2)
    assert "5 mirrored or shifted orders of the tendons fit no better." in found.outcome


def test_orders_are_those_of_polygons() -> None:
    arm = small_arm()
    assert set(common_orders(arm)) == {(1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)}
    square = Anchorage(0.2, Linear(0.006, 0.005))
    two = replace(arm, sections=(square, replace(square, at=0.1)))
    orders = list(common_orders(two))
    assert len(orders) == len(set(orders)) == 2 * 8 - 1
    assert (4, 5, 6, 7, 0, 1, 2, 3) in orders
    own = list(section_orders(two, tuple(range(8)), 1))
    assert len(own) == 7
    assert all(order[:4] == (0, 1, 2, 3) for order in own)
    assert all(sorted(order) == list(range(8)) for order in [*orders, *own])


def test_more_starts_are_tried_if_shapes_are_missed() -> None:
    """From a base turned by 180 degrees the descent has no direction."""
    turned = replace(small_arm(), base_frame=((0.0, 0, -1.0), (0, -1.0, 0), (-1.0, 0, 0)))
    shapes = synthetic(turned, HANGING, 1e-4, 0, [[2.5, 0, 0], [3.0, 0, 0], [2.0, 0, 0]])
    unknowns = [Unknown("arm.base_rotation_deg[0]", -200, 200)]
    found = calibrate(small_arm(), HANGING, shapes, unknowns)
    assert len(found.starts) > 1
    assert found.unreached == ()
    assert abs(found.values[0]) == pytest.approx(180.0, abs=1.0)
    once = calibrate(small_arm(), HANGING, shapes, unknowns, starts=1)
    assert len(once.starts) == 1


def _refused(**given: Any) -> Callable[[], object]:
    return lambda: Measured(**({"tip": (0.0, 0.0, -0.2)} | given))


def _calibrated(measured: Measured, unknown: Unknown = E, **options: Any) -> Callable[[], object]:
    return lambda: calibrate(small_arm(), HANGING, [measured], [unknown], **options)


PULLED = Measured([1.0, 0.0, 0.0], tip=(0.0, 0.0, -0.2))
HELD = Measured(strokes=(0.002, None, None), tip=(0.0, 0.0, -0.2))
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "all slack": (_refused(strokes=(None, None, None)), "Measured: strokes = .*of some tendon"),
    "neither": (
        _refused(tensions=(1.0, None, 0.0), strokes=(0.001, None, None)),
        r"tensions\[1\] = None: must be a tension, or a length or stroke of this tendon",
    ),
    "no readings": (_refused(tensions=(1.0, None, 0.0)), r"tensions\[1\]"),
    "held twice": (
        _refused(tensions=(None, 0.0, 0.0), lengths=(0.2,) * 3, strokes=(0.0,) * 3),
        "strokes.*omitted, or else lengths, for tendons without tension",
    ),
    "two strokes": (_calibrated(replace(HELD, strokes=(0.002, None))), "3 numbers, one for each"),
    "a stroke in mm": (
        _calibrated(replace(HELD, strokes=(None, 0.3, None))),
        "strokes, T_12 = 0.3.*is it in mm",
    ),
    "a word": (_refused(strokes=("far", None, None)), r"strokes\[0\]"),
    "stretch of nothing": (_calibrated(PULLED, tendon_EA=100.0), "tendon_EA = 100.0.*omitted"),
    "outside of nothing": (_calibrated(PULLED, tendon_outside=0.1), "tendon_outside = 0.1"),
    "no stiffness": (_calibrated(HELD, tendon_EA=0.0), "tendon_EA = 0.0.*above 0"),
    "negative bound": (
        _calibrated(HELD, Unknown("winches.tendon_EA_N", 0, 100)),
        "winches.tendon_EA_N: lower = 0.0: must be a number above 0",
    ),
    "no such winch": (_calibrated(HELD, Unknown("winches.zero_mm[3]", -1, 1)), r"\[0\] to \[2\]"),
    "no zero": (_calibrated(HELD, Unknown("winches.zero_mm[0]", 1, 2)), "0 mm"),
}


@pytest.mark.parametrize(("attempt", "told"), REFUSED.values(), ids=REFUSED)
def test_unsuitable_winches_are_refused(attempt: Callable[[], object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        attempt()
