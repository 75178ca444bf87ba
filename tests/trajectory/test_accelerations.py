"""Motions with limited accelerations of strokes: closed forms, and limits at every instant."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.support.errors import ConvergenceError
from octoplan.planner import trajectory
from octoplan.planner.extensions.trajectory.question import Rates
from octoplan.planner.extensions.trajectory.time_law import Stretch, fastest, fastest_pace
from octoplan.planner.targets import TipPosition
from tests.oracles import Array

ARM, SCENE = Arm.from_paper("table-4"), Scene(Extension())
TARGETS = [TipPosition((0.32, 0.08, -0.1)), TipPosition((0.3, 0.12, -0.12))]


def _still(lengths: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return lengths with the position of a fixed tip appended."""
    return lambda T: np.concatenate([lengths(T), np.zeros(3)])


@pytest.mark.parametrize(
    ("rate", "expected"),
    [(np.inf, 2 * np.sqrt(0.03 / 0.5)), (0.08, 0.03 / 0.08 + 0.08 / 0.5)],
    ids=["two parabolas", "a steady part between them"],
)
def test_one_winch_takes_the_time_of_bang_bang(rate: float, expected: float) -> None:
    """Return the time from rest to rest over D: 2 sqrt(D / a), or D / v + v / a at the rate v."""
    stretch = Stretch.of(_still(lambda T: 0.4 - 0.03 * T), np.zeros(1), np.ones(1))
    law = fastest(stretch, Rates((np.inf,), rate, 0.5))
    assert law.x[-1] == pytest.approx(expected, rel=2e-3)
    assert law.x[-1] >= expected * (1 - 1e-9)


def test_one_winch_along_a_curved_length_is_no_faster_than_bang_bang() -> None:
    """The pace of l(T) is free: the time is that of the same change of length along a line."""
    stretch = Stretch.of(_still(lambda T: 0.4 - 0.03 * T / (1 + T)), np.zeros(1), np.ones(1))
    law = fastest(stretch, Rates((np.inf,), np.inf, 0.5))
    bound = 2 * np.sqrt(0.015 / 0.5)
    assert bound * (1 - 1e-9) <= law.x[-1] <= bound * 1.02


def test_a_stretch_on_which_places_change_by_rounding_alone_is_no_snap() -> None:
    rng = np.random.default_rng(0)
    places = _still(lambda T: 0.4 + 1e-14 * rng.normal(size=1))
    stretch = Stretch.of(places, np.zeros(1), np.full(1, 1e-12))
    assert fastest(stretch, Rates((np.inf,), np.inf, 0.5)).x[-1] < 1e-4


def test_a_stretch_whose_second_derivative_jumps_is_no_snap_and_one_that_jumps_is() -> None:
    """With friction of tendons the arm was reported to snap if a curvature changes its sign."""
    bent = _still(lambda T: 0.4 - 0.03 * T - 0.01 * (T - 0.3) * np.abs(T - 0.3))
    ends = np.zeros(1), np.ones(1)
    stretch = Stretch.of(bent, *ends, at_last=1e-6)
    u = np.linspace(0.0, 1.0, 101)
    exact = -0.03 - 0.02 * np.abs(u - 0.3)
    assert stretch.derivatives(u)[0][:, 0] == pytest.approx(exact, abs=2e-4)
    jump = _still(lambda T: 0.4 - 0.03 * T - 1e-3 * (T > 0.3))
    for places, allowed in ((bent, 0.0), (jump, 1e-6)):
        with pytest.raises(ConvergenceError, match="snaps"):
            Stretch.of(places, *ends, at_last=allowed)


def test_a_limit_of_tension_rates_holds_as_well() -> None:
    stretch = Stretch.of(_still(lambda T: 0.4 - 0.03 * T), np.zeros(1), np.ones(1))
    law = fastest(stretch, Rates((2.0,), np.inf, 0.5))
    assert fastest_pace(law).max() == pytest.approx(2.0, rel=1e-6)
    assert law.x[-1] == pytest.approx(1 / 2.0 + 0.06 / 0.5, rel=2e-3)


@pytest.mark.quick("times")
@pytest.mark.parametrize("given", [{}, {"times": [1.5, 3.0]}], ids=["least time", "times"])
def test_accelerations_of_strokes_keep_to_their_limit(given: dict[str, list[float]]) -> None:
    most, rate = 0.2, 0.05
    limits = {"stroke_rate_max": rate, "stroke_acceleration_max": most}
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, **limits, **given)  # type: ignore[arg-type]
    assert tr.certificate.passed, tr.outcome
    assert tr.certificate.stroke_acceleration <= 1 + 1e-3
    if given:
        np.testing.assert_allclose(tr.times[list(tr.stops)], given["times"])
    t = np.linspace(0.0, tr.duration, 241)
    lengths = np.array([settle(ARM, T, SCENE, 1e-10).tendon_lengths for T in tr.at(t)])
    speeds = np.diff(lengths, axis=0) / t[1]
    assert np.abs(speeds).max() <= rate * (1 + 1e-3)
    # Means over two steps are never above the limit, and rest is at both ends.
    assert (np.abs(np.diff(speeds, axis=0)) / t[1]).max() <= most * (1 + 2e-3)
    assert np.abs(speeds[[0, -1]]).max() <= most * t[1]
    # No motion is faster than that of each tendon alone, from rest to rest.
    moved = np.abs(lengths[-1] - lengths[0]).max()
    assert tr.duration >= 2 * np.sqrt(moved / most) - 1e-9


def test_accelerations_alone_limit_a_motion() -> None:
    tr = trajectory(ARM, TARGETS[:1], SCENE, 20.0, stroke_acceleration_max=0.2)
    assert tr.certificate.passed, tr.outcome
    moved = np.abs(tr.lengths[-1] - tr.lengths[0]).max()
    assert 2 * np.sqrt(moved / 0.2) <= tr.duration <= 1.1 * 2 * np.sqrt(moved / 0.2)


def test_the_tip_alone_takes_the_time_of_bang_bang_along_a_line() -> None:
    """Return the time from rest to rest over D: 2 sqrt(D / a), in any direction."""
    way = np.array([0.2, -0.1, 0.2])
    stretch = Stretch.of(lambda T: np.append(np.full(1, 0.4), T * way), np.zeros(1), np.ones(1))
    law = fastest(stretch, Rates((np.inf,), tip_acceleration=0.5))
    expected = 2 * np.sqrt(0.3 / 0.5)
    assert expected * (1 - 1e-9) <= law.x[-1] <= expected * 1.01


def test_the_tip_on_a_circle_is_between_bounds() -> None:
    """Going round at radius r: no sooner than along a line of that length, no faster than
    sqrt(a r); and later than that line by no more than a steady part at half the acceleration."""
    radius, most, turn = 0.1, 0.5, 3.0
    places = lambda T: np.array(  # noqa: E731
        [0.4, radius * np.cos(turn * T[0]), radius * np.sin(turn * T[0]), 0.0]
    )
    stretch = Stretch.of(places, np.zeros(1), np.ones(1))
    law = fastest(stretch, Rates((np.inf,), tip_acceleration=most))
    assert law.x[-1] >= 2 * np.sqrt(radius * turn / most)
    assert (fastest_pace(law) * radius * turn).max() <= np.sqrt(most * radius) * (1 + 1e-6)
    assert law.x[-1] <= radius * turn / np.sqrt(most * radius) + 2.0 * np.sqrt(radius / most)


@pytest.mark.quick("paper")
@pytest.mark.parametrize("scene", [SCENE, Scene.silicone()], ids=["paper", "silicone"])
def test_a_quasi_static_motion_accelerates_its_tip_by_a_tenth_of_gravity(scene: Scene) -> None:
    tr = trajectory(ARM, TARGETS, scene, 20.0, quasi_static=True)
    assert tr.certificate.passed, tr.outcome
    assert tr.certificate.tip_acceleration == pytest.approx(1.0, abs=2e-2)
    assert "Slow enough to be quasi-static" in tr.outcome
    # The motion still takes less than the arm's slowest oscillation.
    assert np.diff(tr.times[[0, *tr.stops]]).min() < tr.period
    assert "but not by the slowest period of the arm" in tr.outcome
    # Means over two steps of settled shapes at even instants never exceed the limit.
    t = np.linspace(0.0, tr.duration, 241)
    tips = np.array([settle(ARM, T, scene, 1e-9).tip for T in tr.at(t)])
    second = np.linalg.norm(np.diff(tips, 2, axis=0), axis=1) / t[1] ** 2
    assert 0.5 * 0.981 < second.max() <= 0.981 * (1 + 2e-3)
    # No motion from rest to rest is sooner than that along a straight line.
    steps = np.linalg.norm(
        np.diff([s.tip for s in map(tr.shape, [0, *tr.way.starts[1:]])], axis=0), axis=1
    )
    assert tr.duration >= (2 * np.sqrt(steps / 0.981)).sum()


def test_an_acceleration_of_the_tip_beside_given_times_is_certified() -> None:
    given = {"tip_acceleration_max": 2.0}
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, times=[3.0, 6.0], **given)
    assert tr.certificate.passed, tr.outcome
    assert tr.inertia == pytest.approx(2.0 / 9.81 * tr.certificate.tip_acceleration, rel=1e-9)
