"""Motions: targets, limits and rates at every instant, certificate and command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from matplotlib.animation import writers
from PIL import Image

from octoplan.model import Anchorage, Arm, InputError, Linear, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles import Moving, Sphere
from octoplan.model.support.errors import FileError, TimeLimitError
from octoplan.planner import Trajectory, plan, trajectory
from octoplan.planner.certificate import Certificate
from octoplan.planner.extensions.trajectory.certificate import MotionCertificate
from octoplan.planner.extensions.trajectory.question import waypoints_of
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.commands.files import schema_of
from octoplan.planner.frontends.plots.motion import animate_trajectory, save_motion
from octoplan.planner.targets import Fetch, TipPosition

ARM, SCENE = Arm.from_paper("table-4"), Scene(Extension())
PLACES = [(0.32, 0.08, -0.1), (0.3, 0.12, -0.12), (0.28, 0.08, -0.15)]
TARGETS = [TipPosition(place) for place in PLACES]


@pytest.fixture(scope="module")
def quickest() -> Trajectory:
    return trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=2.0)


def test_a_motion_meets_its_targets_in_order(quickest: Trajectory) -> None:
    assert quickest.certificate.passed, quickest.outcome
    assert quickest.reached == (True, True, True)
    for stop, place in zip(quickest.stops, PLACES, strict=True):
        tip = settle(ARM, quickest.tensions[stop], SCENE, 1e-8).tip
        assert np.linalg.norm(tip - place) < 1e-6 * ARM.length
    assert quickest.outcome.startswith("Reached")


def test_no_limit_or_rate_is_exceeded_at_any_of_many_instants(quickest: Trajectory) -> None:
    t = np.linspace(0.0, quickest.duration, 10_001)
    T = quickest.at(t)
    assert T.min() >= 0
    assert T.max() <= 20.0
    rates = np.abs(np.diff(T, axis=0)) / np.diff(t)[:, None]
    assert rates.max() <= 2.0 * (1 + 1e-6)
    # In least time a rate is at its limit, and the certificate states the true rate.
    assert quickest.certificate.rate == pytest.approx(rates.max() / 2.0, rel=1e-6)
    assert quickest.certificate.rate == pytest.approx(1.0, rel=1e-6)


def test_the_least_time_is_between_a_bound_and_that_of_plans_one_by_one(
    quickest: Trajectory,
) -> None:
    tensions = [np.zeros(12), *(np.ravel(plan(ARM, own, SCENE, 20.0).tensions) for own in TARGETS)]
    one_by_one = np.abs(np.diff(tensions, axis=0)).max(axis=1).sum() / 2.0
    assert quickest.duration < one_by_one
    # The first target alone, from rest, takes no longer than the whole motion to it.
    alone = trajectory(ARM, TARGETS[:1], SCENE, 20.0, rate_max=2.0)
    assert alone.duration <= quickest.times[1] * (1 + 1e-3)
    assert alone.duration <= quickest.duration


def test_in_a_given_time_effort_is_least_and_plans_are_kept_where_rates_allow() -> None:
    times = [10.0, 20.0, 30.0]
    slow = trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=2.0, times=times)
    assert slow.certificate.passed, slow.outcome
    np.testing.assert_allclose(slow.times[1:], times)
    alone = plan(ARM, TARGETS[1], SCENE, 20.0)
    np.testing.assert_allclose(slow.tensions[2], alone.tensions, atol=2e-3)


def test_strokes_keep_to_their_rate() -> None:
    tr = trajectory(ARM, TARGETS[:2], SCENE, 20.0, stroke_rate_max=0.02)
    assert tr.certificate.passed, tr.outcome
    t = np.linspace(0.0, tr.duration, 101)
    lengths = np.array([settle(ARM, T, SCENE, 1e-6).tendon_lengths for T in tr.at(t)])
    assert (np.abs(np.diff(lengths, axis=0)) / np.diff(t)[:, None]).max() < 0.02 * 1.02


def test_a_motion_starts_at_a_plan() -> None:
    start = plan(ARM, TARGETS[0], SCENE, 20.0)
    tr = trajectory(ARM, TARGETS[1:2], SCENE, 20.0, rate_max=2.0, start=start)
    np.testing.assert_array_equal(tr.tensions[0], start.tensions)
    assert tr.certificate.passed


@pytest.mark.slow
def test_a_motion_keeps_clear_between_its_waypoints(quickest: Trajectory) -> None:
    middle = quickest.at(0.5 * (quickest.times[1] + quickest.times[2]))
    place = settle(ARM, middle, SCENE).position(0.8 * ARM.length)
    obstacle = Sphere(place + np.array([0.0, 0.0, 0.02]), 0.02)
    given = {"obstacles": [obstacle], "clearance": 0.001}
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=2.0, **given)
    assert tr.certificate.passed, tr.outcome
    s = np.linspace(0.0, ARM.length, 400)
    R = ARM.radius.evaluate(s, ARM.length)[0]
    for T in tr.at(np.linspace(0.0, tr.duration, 200)):
        gap = obstacle.distance(settle(ARM, T, SCENE, 1e-5).position(s)) - R
        assert gap.min() >= 0.001 + tr.certificate.clearance - 1e-6


def test_a_motion_is_saved_for_a_robot(quickest: Trajectory, tmp_path: Path) -> None:
    rows = np.genfromtxt(quickest.save(tmp_path / "motion.csv"), delimiter=",", names=True)
    np.testing.assert_array_equal(rows["t_s"], quickest.times)
    np.testing.assert_array_equal(rows["T_21_N"], quickest.flat[:, 4])
    np.testing.assert_allclose(rows["T_11_length_m"], quickest.lengths[:, 0])
    with pytest.raises(InputError, match="csv"):
        quickest.save(tmp_path / "motion.txt")


def test_a_motion_is_shown_in_the_time_that_it_takes(quickest: Trajectory, tmp_path: Path) -> None:
    film = animate_trajectory(quickest, fps=4.0, seconds=1.0)
    path = save_motion(film, tmp_path / "motion.gif", 20)
    with Image.open(path) as shown:
        assert shown.n_frames == 5
        assert shown.info["duration"] == pytest.approx(250, abs=10)
    if not writers.is_available("ffmpeg"):
        with pytest.raises(InputError, match="ffmpeg"):
            quickest.save(tmp_path / "motion.mp4")


def test_functions_and_files_are_paths(tmp_path: Path) -> None:
    found, times = waypoints_of(ARM, lambda u: (0.3, 0.1 * u, 0.0), 3)
    assert found == tuple((TipPosition((0.3, y, 0.0)),) for y in (0.0, 0.05, 0.1))
    assert times is None
    file = tmp_path / "path.csv"
    file.write_text("t_s,x_m,y_m,z_m\n1,0.3,0,0\n2,0.3,0.1,0\n")
    found, times = waypoints_of(ARM, file, 3)
    assert found == ((TipPosition((0.3, 0.0, 0.0)),), (TipPosition((0.3, 0.1, 0.0)),))
    assert times is not None
    assert times.tolist() == [1.0, 2.0]
    file.write_text("x_m,y_m,z_m\n0.3,zero,0\n")
    with pytest.raises(FileError, match=r"line 2: y_m = 'zero': must be a number"):
        waypoints_of(ARM, file, 3)


@pytest.mark.slow
def test_a_path_that_leaves_the_reach_is_refused_with_from_where_to_where() -> None:
    beyond = [TipPosition((x, 0.05, 0.0)) for x in (0.42, 0.5, 0.52, 0.42)]
    with pytest.raises(
        InputError, match=r"targets\[1\] to \[2\] = TipPosition.*: must be within reach"
    ):
        trajectory(ARM, beyond, SCENE, 20.0, rate_max=2.0)


BALL, NAN = Sphere((0.25, 0.0, 0.02), 0.02), np.nan
# Arguments of a motion, and the result.
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({}, "times"),
    ({"rate_max": 0.0}, "rate_max"),
    ({"rate_max": NAN}, "rate_max"),
    ({"stroke_rate_max": -1.0}, "stroke_rate_max"),
    *(
        ({"stroke_acceleration_max": wrong}, "stroke_acceleration_max")
        for wrong in (0.0, -1.0, NAN)
    ),
    *(({"tip_acceleration_max": x}, "tip_acceleration_max") for x in (0.0, NAN)),
    ({"quasi_static": 1}, "quasi_static"),
    ({"quasi_static": True, "tip_acceleration_max": 1.0}, "tip_acceleration_max"),
    ({"rate_max": 1.0, "times": [1.0]}, "times"),
    ({"rate_max": 1.0, "times": [1.0, 0.5, 2.0]}, "times"),
    (
        {"rate_max": 0.1, "times": [0.5, 20.0, 40.0]},
        r"times\[0\].*s after the target before; or raise the limits",
    ),
    (
        {"stroke_acceleration_max": 0.2, "times": [0.1, 9.0, 20.0]},
        r"times\[0\].*s after the target before",
    ),
    (
        {"tip_acceleration_max": 2.0, "times": [0.1, 6.0, 20.0]},
        r"times\[0\].*s after the target before",
    ),
    ({"rate_max": 1.0, "start": 3.0}, "start"),
    ({"rate_max": 1.0, "clearance": -1.0}, "clearance"),
    ({"rate_max": 1.0, "obstacles": [Sphere(PLACES[1], 0.01)]}, "obstacles"),
    (
        {"rate_max": 1.0, "obstacles": [BALL]},
        r"start.*passes through obstacles\[0\].*s = ",
    ),
    ({"rate_max": 1.0, "scene": Scene.as_printed()}, r"scene.*as printed"),
    ({"rate_max": 1.0, "targets": []}, "targets"),
    ({"rate_max": 1.0, "targets": 3.0}, "targets"),
]


@pytest.mark.parametrize(("given", "told"), REFUSED)
def test_what_a_motion_cannot_be_is_refused_by_name(given: dict[str, Any], told: str) -> None:
    asked = {"targets": TARGETS, "scene": SCENE, "tension_max": 20.0, **given}
    with pytest.raises(InputError, match=told):
        trajectory(ARM, **asked)


@pytest.mark.parametrize(
    ("times", "path", "told"),
    [
        ((0.0, 0.0), ((0, 0, 0), (1, 0, 0)), "times"),
        ((0.0,), ((0, 0, 0),), "times"),
        ((0.0, 1.0), ((0, 0, 0),), "path"),
        ((0.0, 1.0), ((0, 0, 0), (NAN, 0, 0)), "path"),
    ],
)
def test_paths_of_obstacles_that_are_none_are_refused(times: Any, path: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Moving(BALL, times, path)


def test_a_motion_among_obstacles_says_nothing_by_itself(capfd: pytest.CaptureFixture[str]) -> None:
    """LAPACK complained of waypoints without targets, whose systems had no rows."""
    ball = Sphere((0.2, 0.12, -0.12), 0.03)
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=2.0, obstacles=[ball], progress=False)
    assert tr.certificate.passed, tr.outcome
    assert capfd.readouterr() == ("", "")


def test_targets_far_apart_are_reached_from_the_first_as_well_as_one_by_one() -> None:
    """The program over all waypoints begins at the plan for the first alone."""
    places = [(0.15, 0.25, -0.1), (0.2, -0.2, 0.15), (0.35, 0.0, 0.15), (0.1, -0.1, -0.3)]
    targets = [TipPosition(place) for place in places]
    times = [20.0, 40.0, 60.0, 80.0]
    tr = trajectory(ARM, targets, SCENE, 20.0, rate_max=5.0, times=times)
    assert tr.certificate.passed, tr.outcome
    alone = [np.ravel(plan(ARM, own, SCENE, 20.0).tensions) for own in targets]
    assert (tr.flat[1:] ** 2).sum() <= 1.001 * np.sum(np.square(alone))


def test_a_motion_that_takes_too_long_is_told() -> None:
    with pytest.raises(TimeLimitError):
        trajectory(ARM, lambda u: (0.3, 0.1 * u, 0.0), SCENE, 20.0, rate_max=1.0, time_limit=1e-3)


MET = Certificate(bounds=0.0, kkt=0.0, agreement=0.0)
SOUND = MotionCertificate(at_targets=(MET,), bounds=0.0, rate=1.0)


def at_target(**changed: Any) -> dict[str, Any]:
    """Return a certificate of the target with something changed."""
    return {"at_targets": (replace(MET, **changed),)}


SPOILT: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "target 0 is off": (at_target(equality={"tip": 0.9e-6}), at_target(equality={"tip": 1.1e-6})),
    "target 0 is": (at_target(inequality={"gap": -0.9e-6}), at_target(inequality={"gap": -1.1e-6})),
    "at target 0 integrators": (at_target(agreement=0.9e-6), at_target(agreement=1.1e-6)),
    "at target 0 the arm does not stand": (at_target(stability=0.0), at_target(stability=-1e-9)),
    "tension limit": ({"bounds": 0.0}, {"bounds": 1e-12}),
    "limit of strokes": ({"strokes": 0.0}, {"strokes": 1e-12}),
    "rate of tension": ({"rate": 1.0}, {"rate": 1.001}),
    "rate of stroke": ({"stroke_rate": 1 + 0.9e-3}, {"stroke_rate": 1 + 1.1e-3}),
    "acceleration of a stroke": (
        {"stroke_acceleration": 1 + 0.9e-3},
        {"stroke_acceleration": 1 + 1.1e-3},
    ),
    "tip's acceleration": (
        {"tip_acceleration": 1 + 0.9e-3},
        {"tip_acceleration": 1 + 1.1e-3},
    ),
    "jumps on its way to waypoint 2": ({"jumps": ()}, {"jumps": (2,)}),
    "less than asked": ({"clearance": 0.0}, {"clearance": -1e-9}),
}


@pytest.mark.parametrize("name", SPOILT)
def test_each_check_fails_just_above_its_tolerance_and_passes_just_below(name: str) -> None:
    allowed, spoilt = SPOILT[name]
    assert SOUND.passed, SOUND.failures
    assert replace(SOUND, **allowed).passed
    (failure,) = replace(SOUND, **spoilt).failures
    assert name in failure


FILE = """
[arm]
preset = "table-4"
[effects]
extension = true
[limits]
tension_max = 20
[motion]
rate_max = 5
[[waypoints]]
type = "tip-position"
position_mm = [320, 80, -100]
[[waypoints]]
type = "tip-position"
position_mm = [300, 120, -120]
"""


def test_the_command_prints_what_its_schema_says_and_writes_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(FILE)
    out = tmp_path / "out"
    assert main(["trajectory", str(scene), "--json", "--out", str(out)]) == 0
    record = json.loads(capsys.readouterr().out)
    jsonschema.validate(record, schema_of("trajectory"))
    assert record["certified"]
    assert record["reached"] == [True, True]
    assert (out / "trajectory.csv").read_text().startswith("t_s,T_11_N")
    assert (out / "trajectory.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[motion]\nrate_max = 5\n", "", "motion.rate_max: missing"),
        ("rate_max = 5", "rate_max = -5", "motion.rate_max"),
        ("rate_max = 5", "times_s = [1.0]", "times"),
        ("rate_max = 5", "tip_acceleration_max_m_s2 = 0", "tip_acceleration_max_m_s2"),
        ("[limits]\ntension_max = 20\n", "", "limits: missing"),
        ("[[waypoints]]", "[[waypoint]]", "waypoints"),
    ],
)
def test_what_is_wrong_in_the_file_is_told_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, told: str
) -> None:
    assert old in FILE
    scene = tmp_path / "scene.toml"
    scene.write_text(FILE.replace(old, new))
    assert main(["trajectory", str(scene)]) == 2
    assert told in capsys.readouterr().err


def test_a_motion_to_where_the_body_is_all_but_crushed_is_certified() -> None:
    """The mesh was coarser than a margin of stretch allowed for: the arm was crushed there."""
    arm, bent = Arm.from_paper("table-4"), TipPosition((0.15, 0.15, 0.0))
    motion = trajectory(arm, [bent], Scene(Extension()), 13.0, rate_max=5.0)
    assert motion.certificate.passed, motion.outcome
    stretch = 1 + motion.shapes[-1].strain(np.linspace(0, arm.length, 2001))[:, 3]
    assert 0 < stretch.min() < 0.01


def test_a_waypoint_takes_the_mirror_image_that_is_near() -> None:
    """A fetch in the plane of the earlier waypoints may be met on either side of the plane."""
    targets = [TipPosition((0.3, 0.12, 0.0)), TipPosition((0.15, 0.15, 0.0))]
    mouth = Fetch.reach((0.0, 0.0, 0.0), float(np.radians(30)), float(np.radians(-90)))
    durations = [
        trajectory(ARM, each, SCENE, 13.0, rate_max=5.0).duration
        for each in ([mouth], [*targets, mouth])
    ]
    assert durations[1] == pytest.approx(durations[0], rel=1e-3)


def test_a_target_that_is_repeated_takes_no_time() -> None:
    """The motion accelerated by a million times gravity from one target to the other."""
    arm = Arm(0.36, Linear(0.0185, 0.009), (Anchorage(0.36, Linear(0.015, 0.0073)),))
    silicone = Scene.silicone()
    target = TipPosition(settle(arm, [[0.16, 0, 0, 0]], silicone, 1e-8).tip)
    once, twice = (
        trajectory(arm, [target] * count, silicone, 1.0, rate_max=5.0) for count in (1, 2)
    )
    assert twice.certificate.passed, twice.outcome
    assert twice.duration == pytest.approx(once.duration, rel=1e-3)
    assert twice.inertia == pytest.approx(once.inertia, rel=1e-3)


def test_a_motion_in_the_plane_of_two_tendons_is_as_accurate_as_its_plans() -> None:
    """No program over the waypoints has an optimum: a place has more numbers than waypoints."""
    arm = Arm(0.24, Linear(0.013, 0.007), (Anchorage(0.24, Linear(0.006, 0.003), (0.6, 6.0)),))
    tips = [settle(arm, [[0.0, pull]], SCENE, 1e-8).tip for pull in (0.2, 0.1)]
    motion = trajectory(arm, list(map(TipPosition, tips)), SCENE, 1.0, rate_max=0.1)
    assert motion.certificate.passed, motion.outcome


@pytest.mark.parametrize(
    ("start", "told"), [(13.0, "the arm is crushed"), (0.6, "limit is violated by 0.1 N")]
)
def test_where_a_motion_begins_is_verified_too(start: float, told: str) -> None:
    begun = trajectory(
        ARM, TARGETS[:1], SCENE, 0.5, rate_max=1.0, start=[[start] * 4, [0] * 4, [0] * 4]
    )
    assert not begun.certificate.passed
    assert told in begun.outcome
