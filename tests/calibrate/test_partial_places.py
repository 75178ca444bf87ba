"""Places with missing coordinates, and CSV files as cameras and spreadsheets write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Material, settle
from octoplan.model.support.errors import FileError
from octoplan.planner import Measured, Unknown, calibrate, load_calibration
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.measured import Point
from octoplan.planner.frontends.io.csv_files import MarkerColumns, load_shapes, load_waypoints
from tests.calibrate.cases import HANGING, MARKERS, PULLS, small_arm, synthetic

UNKNOWNS = [Unknown("arm.E_kPa", 50, 300), Unknown("arm.density", 500, 2000)]
# These pulls bend the small arm in the plane of y and z.
IN_PLANE = [[T, 0.0, 0.0] for T in (0.5, 1.0, 2.0, 3.0)] + [[0.0, T, T] for T in (0.5, 1.5)]
NAN = float("nan")


def _without(axis: int, shapes: list[Measured]) -> list[Measured]:
    """Return shapes whose markers lack a coordinate."""

    def partial(point: Point) -> tuple[object, ...]:
        place = [x if k != axis else None for k, x in enumerate(point.place or ())]
        return point.s, point.offset, place

    return [replace(m, points=list(map(partial, m.points))) for m in shapes]


def _fitted(shapes: list[Measured]) -> Calibration:
    off = replace(small_arm(), material=Material(95e3, 0.45, 1300.0))
    given = [replace(m, std=5e-4) for m in shapes]
    return calibrate(off, HANGING, given, UNKNOWNS, absolute_std=True, accuracy=1e-6)


def _planar() -> list[Measured]:
    """Return markers on the midline of an arm that bends in a plane, with noise."""
    rng = np.random.default_rng(3)
    shapes = []
    for i, T in enumerate(IN_PLANE):
        shape = settle(small_arm(), T, HANGING, 1e-8)
        places = [shape.position(s) + 5e-4 * rng.normal(size=3) for s, _ in MARKERS]
        points = [(s, (0, 0, 0), place) for (s, _), place in zip(MARKERS, places, strict=True)]
        shapes.append(Measured(T, points, name=f"{i}"))
    return shapes


def test_a_coordinate_that_carries_nothing_may_be_missing() -> None:
    """The plane of bending is y, z: values and errors do not depend on x."""
    full = _fitted(_planar())
    partial = _fitted(_without(0, _planar()))
    assert partial.values == pytest.approx(full.values, rel=1e-6)
    assert partial.std == pytest.approx(full.std, rel=1e-6)
    assert full.degrees_of_freedom == len(IN_PLANE) * 2 * 3 - 2
    assert partial.degrees_of_freedom == len(IN_PLANE) * 2 * 2 - 2


def test_a_side_camera_identifies_an_arm_that_leaves_its_plane() -> None:
    found = _fitted(_without(1, synthetic(small_arm(), HANGING, 0.0, 0)))
    assert found.values == pytest.approx((120.0, 1100.0), rel=1e-4)
    assert found.degrees_of_freedom == len(PULLS) * 2 * 2 - 2
    assert f"{len(PULLS)} shapes, {len(PULLS) * 4} numbers, 2 unknowns" in found.outcome


def test_intervals_from_two_coordinates_hold_the_true_values() -> None:
    """95 % intervals of 20 noisy data sets hold the truth in all but a few."""
    held = 0
    for seed in range(20):
        shapes = _without(1, synthetic(small_arm(), HANGING, 1e-3, seed))
        found = calibrate(small_arm(), HANGING, shapes, UNKNOWNS[:1])
        low, high = found.interval()[0]
        held += low <= 120.0 <= high
    assert held >= 17  # the probability of fewer is 1.6 %


def test_missing_coordinates_are_none_or_nan() -> None:
    by_none = Measured([1, 0, 0], [(0.1, (0, 0, 0), (0.1, None, -0.1))], tip=(None, 0.0, None))
    places = np.array([[0.1, NAN, -0.1], [NAN, 0.0, NAN]])
    by_nan = Measured([1, 0, 0], [(0.1, (0, 0, 0), places[0])], tip=places[1])
    assert by_none == by_nan
    assert by_none.size == 3
    assert by_none.data.tolist() == [0.1, -0.1, 0.0]
    assert np.array_equal(by_none.places, places, equal_nan=True)


@pytest.fixture(scope="module")
def partial() -> Calibration:
    """A calibration by shapes of which some coordinates are missing, and one marker."""
    shapes = synthetic(small_arm(), HANGING, 1e-4, 0)
    shapes[0] = _without(2, shapes[:1])[0]
    shapes[1] = replace(shapes[1], points=[(*MARKERS[0], None), shapes[1].points[1]])
    shapes[2] = replace(shapes[2], points=(), tip=settle(small_arm(), PULLS[2], HANGING).tip)
    shapes[3] = replace(shapes[3], points=(), tip=(0.0, NAN, -0.1), std=0.1)
    return calibrate(small_arm(), HANGING, shapes, UNKNOWNS[:1])


def test_residuals_keep_the_axes_of_missing_coordinates(partial: Calibration) -> None:
    rows = {(row.shape, row.what): row.miss for row in partial.residuals}
    assert np.isnan(rows["shape 0", "points[1]"]).tolist() == [False, False, True]
    assert np.isnan(rows["shape 3", "tip"]).tolist() == [False, True, False]
    assert ("shape 1", "points[0]") not in rows
    predicted = settle(partial.arm, PULLS[3], HANGING, 1e-7).tip
    miss = np.array(rows["shape 3", "tip"])
    assert miss[[0, 2]] == pytest.approx((predicted - [0.0, 0.0, -0.1])[[0, 2]], abs=1e-6)
    (tip,) = [row for row in partial.residuals if row.shape == "shape 3"]
    assert tip.size == pytest.approx(np.hypot(miss[0], miss[2]))


def test_partial_places_are_cross_validated_saved_and_drawn(
    partial: Calibration, tmp_path: Path
) -> None:
    left = partial.leave_out()
    assert len(left.held) == 2 + 1 + 1 + 1
    assert np.isfinite(left.mean_error)
    again = load_calibration(partial.save(tmp_path / "partial.json"))
    assert again == partial
    assert again.measured[0].points[0].place == partial.measured[0].points[0].place
    assert '"miss":[' in (tmp_path / "partial.json").read_text().replace(" ", "")
    assert partial.plot() is not None


def test_an_ellipsoid_has_the_dimension_of_the_measured_coordinates(partial: Calibration) -> None:
    there = partial.predict([1.0, 0.0, 0.0])
    away = there.band()[0] * [0.99, 0.0, 0.0]
    assert there.holds([there.tip + away])
    # The interval of one coordinate is narrower than the ellipsoid of three.
    assert there.holds([np.where([True, False, False], there.tip + away, NAN)])
    assert not there.holds([np.where([True, False, False], there.tip + away / 0.98, NAN)])


COLUMNS = ["name", "T_11_N", "T_12_N", "T_13_N", "M1_x_mm", "M1_z_mm", "tip_x_mm", "tip_y_mm"]
ROWS = [
    ["first, 1,5 bar", "1.0", "0.0", "0.25", "12.5", "-99.5", "", "3.25"],
    ["second", "1.5", "0.0", "0.5", "nan", "-98.5", "", ""],
    ["third", "1.5", "1e-3", "0.5", "", "", "", "4.0"],
]
MARKER = [MarkerColumns(name="M1", s_mm=100.0)]


def _shapes(path: Path, text: str) -> tuple[Measured, ...]:
    path.write_text(text)
    return load_shapes(path, small_arm(), MARKER)


def _lines(separator: str, decimal: str) -> str:
    rows = [[row[0], *(cell.replace(".", decimal) for cell in row[1:])] for row in ROWS]
    rows[0][0] = f'"{rows[0][0]}"'
    return "\n".join(separator.join(row) for row in [COLUMNS, *rows])


def test_files_have_partial_places_by_columns_and_cells(tmp_path: Path) -> None:
    first, second, third = _shapes(tmp_path / "a.csv", _lines(",", "."))
    assert first.points[0].place == (0.0125, None, -0.0995)
    assert first.tip == (None, 0.00325, None)
    assert second.points[0].place == (None, None, -0.0985)
    assert second.tip is None
    assert third.points[0].place is None
    assert [shape.size for shape in (first, second, third)] == [3, 1, 1]


@pytest.mark.parametrize(("separator", "decimal"), [(";", "."), (";", ",")])
def test_semicolons_and_decimal_commas_are_read(
    tmp_path: Path, separator: str, decimal: str
) -> None:
    wanted = _shapes(tmp_path / "a.csv", _lines(",", "."))
    assert _shapes(tmp_path / "b.csv", _lines(separator, decimal)) == wanted
    assert wanted[0].name == "first, 1,5 bar"


def test_quoted_decimal_commas_are_read_between_commas(tmp_path: Path) -> None:
    text = ",".join(f'"{cell}"' for cell in COLUMNS) + "\n"
    text += ",".join(f'"{cell}"' for cell in ["a", "1,5", "0", "0", "12,5", "-99", "", ""])
    (shape,) = _shapes(tmp_path / "a.csv", text)
    assert shape.tensions == [1.5, 0.0, 0.0]
    assert shape.points[0].place == (0.0125, None, -0.099)


def test_waypoints_have_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("t_s;x_m;y_m;z_m\n0;0,25;0;-0,1\n2,5;0,2;0,05;1e-2\n")
    targets, times = load_waypoints(path)
    assert [target.position for target in targets] == [(0.25, 0.0, -0.1), (0.2, 0.05, 0.01)]
    assert times is not None
    assert times.tolist() == [0.0, 2.5]


def _swap(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new)


AMBIGUOUS = {
    "two marks": (";", ",", _swap("-99,5", "-99.5"), r"line 2: .* = '1,0'.*line 2 has '-99.5'"),
    "thousands and decimals": (";", ".", _swap("12.5", "1,234.5"), "'1,234.5'.*one decimal mark"),
    "thousands or decimals": (
        ";",
        ".",
        lambda text: text.split("\n")[0] + "\na;1;0;0;1,500;99;;\nb;1;0;0;-2,125;99;;",
        r"line 2: M1_x_mm = '1,500'.*cannot separate thousands",
    ),
    "commas for both": (",", ",", _swap("", ""), "line 2.*not 1.*separate cells by semicolons"),
    "two separators": (";", ".", _swap("T_12_N;", "T_12_N,"), "line 1.*one separator"),
    "no number": (
        ";",
        ",",
        _swap("12,5", "12,5,0"),
        "line 2: M1_x_mm = '12,5,0': must be a number",
    ),
}


@pytest.mark.parametrize(
    ("separator", "decimal", "change", "told"), AMBIGUOUS.values(), ids=AMBIGUOUS
)
def test_ambiguous_files_are_refused(
    tmp_path: Path, separator: str, decimal: str, change: Callable[[str], str], told: str
) -> None:
    with pytest.raises(FileError, match=told):
        _shapes(tmp_path / "a.csv", change(_lines(separator, decimal)))
