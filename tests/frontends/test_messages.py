"""Messages have the form `<field> = <given>: must be <allowed>`; outcomes name one remedy."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, InputError, Linear, Material, Scene, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.support.errors import Described, as_given
from octoplan.planner import plan, trajectory
from octoplan.planner.frontends.cli import main
from octoplan.planner.targets import BendingPlane, Fetch, TipPosition

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
NEAR, OTHER = TipPosition((0.35, 0.1, -0.1)), TipPosition((0.3, -0.12, 0.05))
FOUR = tuple(np.radians([0, 90, 180, 270]))


def one_section(**other: Any) -> Arm:
    given: dict[str, Any] = {
        "length": 0.3,
        "radius": Linear(0.006, 0.006),
        "sections": (Anchorage(0.3, Linear(0.003, 0.003), FOUR),),
        "material": Material(E=2e5, nu=0.5, density=1000.0),
    }
    return Arm(**given | other)


def motion(targets: list[Any], **options: Any) -> Callable[[], Any]:
    return lambda: trajectory(ARM, targets, PAPER, 20.0, **options)


MESSAGES: dict[str, tuple[Callable[[], Any], str]] = {
    "a number in place of a vector": (
        lambda: HalfSpace((0, 0, 0), -0.03),  # type: ignore[arg-type]
        "HalfSpace.normal = -0.03: must be 3 numbers",
    ),
    "two coordinates": (
        lambda: TipPosition((0.1, 0.2)),
        "TipPosition.position = (0.1, 0.2): must be 3 numbers",
    ),
    "a vector in place of a frame": (
        lambda: one_section(base_frame=(1, 0, 0)),
        "Arm.base_frame = (1, 0, 0): must be 3 x 3 numbers",
    ),
    "many numbers": (
        lambda: TipPosition(tuple(range(20))),
        "TipPosition.position = 20 numbers: must be 3 numbers",
    ),
    "a word in place of a number": (
        lambda: settle(ARM, np.zeros(12), PAPER, "fine"),  # type: ignore[arg-type]
        "accuracy = 'fine': must be a number",
    ),
    "numbers too few": (
        lambda: settle(ARM, [1, 2]),
        "tensions = 2 numbers: must be 12 numbers, flat or a row per section, tip first (4+4+4)",
    ),
    "a negative tension": (
        lambda: settle(ARM, [[0, 0, -0.1, 0]] * 3),
        "tensions[2] (T_13) = -0.1: must be a number from 0 to 1e+30",
    ),
    "an effect twice": (
        lambda: Scene(Weight(), Weight()),
        "Scene = Weight and Weight: must be each effect once "
        "(loads and masses: once at a place; contacts: a body once)",
    ),
    "buoyancy alone": (
        lambda: Scene(Buoyancy()),
        "Scene = Buoyancy without Weight: must be Buoyancy with Weight: "
        "it is a weight, that of the fluid displaced, and acts against g",
    ),
    "coordinates in place of a target": (
        lambda: plan(ARM, (0.2, 0.1, -0.1), PAPER, 20.0),  # type: ignore[arg-type]
        "target = (0.2, 0.1, -0.1): must be a target such as TipPosition(...), or several",
    ),
    "a word in place of obstacles": (
        lambda: plan(ARM, NEAR, PAPER, 20.0, obstacles="ball"),
        "obstacles = 'ball': must be a list of obstacles, each an obstacle such as "
        "Sphere(center=(x, y, z), radius=r)",
    ),
    "a clearance from nothing": (
        lambda: plan(ARM, NEAR, PAPER, 20.0, clearance=0.002),
        "clearance = 0.002: must be 0 without obstacles; pass obstacles, or self_clearance=True",
    ),
    "targets for different sections": (
        lambda: plan(ARM, (BendingPlane(0, 1.0), BendingPlane(0, 1, 2, "anchorage")), PAPER, 20.0),
        "target = (BendingPlane(angle=0.0, bend=1.0, section=1, at='tip'), BendingPlane(angle=0.0, "
        "bend=1.0, section=2, at='anchorage')): must be targets that let a common tendon pull",
    ),
    "a fetch of one section": (
        lambda: plan(one_section(), Fetch.reach((0.1, 0.1, 0.1)), PAPER, 20.0),
        "arm.sections = 1 section: must be >= 3 for a fetch",
    ),
    "no rate": (
        motion([NEAR]),
        "rate_max = None: must be a rate of tensions [N/s] for the least time; or pass another "
        "limit of rates or accelerations, or times [s]",
    ),
    "a rate of 0": (motion([NEAR], rate_max=0), "rate_max = 0.0: must be a number above 0 [N/s]"),
    "a rate of 0 for a tendon": (
        motion([NEAR], rate_max=[1.0] * 4 + [0.0] + [1.0] * 7),
        "rate_max[4] (T_21) = 0.0: must be a number above 0 [N/s]",
    ),
    "times that decrease": (
        motion([NEAR, OTHER], times=[2, 1]),
        "times[1] = 1.0: must be above 2 s: times increase from target to target",
    ),
    "one time of two": (
        motion([NEAR, OTHER], times=[2]),
        "times = [2.0]: must be 2 times, one for each target",
    ),
    "a preset": (
        lambda: Arm.from_paper("table-3"),
        "name = 'table-3': must be one of table-2, table-4, section-5.1, section-5.2",
    ),
}


@pytest.mark.parametrize(("make", "message"), MESSAGES.values(), ids=MESSAGES)
def test_messages_name_field_value_and_rule(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message


def test_too_little_time_is_refused_with_the_time_that_suffices() -> None:
    with pytest.raises(InputError) as caught:
        motion([NEAR], rate_max=0.1, times=[0.1])()
    pattern = (
        r"times\[0\] = 0\.1: must be >= (\S+) s, \1 s after the target before; or raise the limits "
        r"of rates \S+ times"
    )
    found = re.fullmatch(pattern, str(caught.value))
    assert found
    least = float(found[1])
    assert motion([NEAR], rate_max=0.1, times=[least * 1.001])().certificate.passed


@pytest.mark.slow
def test_a_target_out_of_reach_is_shown_with_the_outcome() -> None:
    with pytest.raises(InputError, match=r"targets\[0\] = TipPosition\(.*\): must be within reach"):
        motion([TipPosition((0.8, 0.1, -0.1))], rate_max=1)()


def test_descriptions_have_no_quotes_and_texts_have() -> None:
    assert as_given(Described("2 rows")) == "2 rows"
    assert as_given("2 rows") == "'2 rows'"
    error = InputError("near", Described("a plan for another arm"), "a plan for this arm")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_values_of_several_lines_are_named_by_their_type() -> None:
    with pytest.raises(InputError, match=r"^near = an Arm: must be a Shape of this arm"):
        settle(ARM, np.zeros(12), PAPER, near=ARM)  # type: ignore[arg-type]


FILE = 'accuracy = 1e-4\n[arm]\npreset = "table-4"\n'
_TARGET = "[target]\ntype = 'tip-position'\nposition_mm = [1, 2, 3]\n"
FILES = {
    "two targets in tables of one": (
        2 * _TARGET,
        "line 7: not valid TOML: cannot declare ('target',) twice: [target]; "
        "several targets have a [[targets]] table each",
    ),
    "text in place of numbers": (
        "[target]\ntype = 'tip-position'\nposition_mm = '1 2 3'\n",
        "target.position_mm = '1 2 3': must be a list of 3 numbers (in the base frame [mm])",
    ),
    "a negative limit": (
        "[limits]\ntension_max = -3\n",
        "limits.tension_max = -3: must be a number >= 0 or a list [...] [N]",
    ),
    "axes of the base that are not orthogonal": (
        "base_frame = { tangent = [1, 0, 0], normal = [1, 0, 0] }\n",
        "arm.base_frame.normal = [1.0, 0.0, 0.0]: must be a vector at right angles to "
        "tangent = [1.0, 0.0, 0.0]",
    ),
}


@pytest.mark.parametrize(("text", "message"), FILES.values(), ids=FILES)
def test_messages_of_files_name_the_key(
    text: str, message: str, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(FILE + text)
    assert main(["plan", str(path)]) == 2
    assert capsys.readouterr().err == f"octoplan: {path}: {message}\n"


def test_a_motion_without_rates_is_missing_a_rate(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table was said to be missing although the file has it."""
    path = tmp_path / "mine.toml"
    waypoint = "[[waypoints]]\ntype = 'tip-position'\nposition_mm = [350, 100, -100]\n"
    path.write_text(f"{FILE}[limits]\ntension_max = 20\n[motion]\n{waypoint}")
    assert main(["trajectory", str(path)]) == 2
    told = f"{path}: motion.rate_max: missing: must be a rate of tensions (N/s), or another limit"
    assert told in capsys.readouterr().err


def test_times_in_a_file_are_named_by_their_key(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    waypoint = "[[waypoints]]\ntype = 'tip-position'\nposition_mm = [350, 100, -100]\n"
    path.write_text(f"{FILE}[limits]\ntension_max = 20\n[motion]\ntimes_s = [1, 2]\n{waypoint}")
    assert main(["trajectory", str(path)]) == 2
    told = f"{path}: motion.times_s = [1.0, 2.0]: must be 1 time, one for each target"
    assert told in capsys.readouterr().err


def test_an_export_of_another_kind_lists_all_kinds(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message was that "stl" is not convertible into a union of Literals."""
    assert main(["export", "mine.toml", "--to", str(tmp_path), "--what", "stl"]) == 2
    assert 'Choose from: "map", "plan", "mesh", "mjcf", "urdf"' in capsys.readouterr().err


def test_a_fetch_that_is_missed_is_off_by_degrees() -> None:
    bends = Fetch((1.2, 0.0), (1.2, 2.0), (1.2, 4.0))
    found = plan(ARM, bends, PAPER, 0.05, starts=1)
    assert not found.reached
    start, end = 0.0, ARM.sections[2].at
    tangent = found.shape.frame(start).T @ found.shape.frame(end)[:, 0]
    wanted = np.array([np.cos(1.2), 0.0, np.sin(1.2)])
    off = np.degrees(np.arccos(tangent @ wanted))
    assert f"the proximal bend by {off:.3g} deg" in found.outcome


def test_an_outcome_has_one_remedy() -> None:
    found = plan(ARM, BendingPlane(1.0, 1.0), Scene(Extension(), ExactTendons()), 1e-3, starts=1)
    assert found.outcome.count("; widen these limits (") == 1
    assert "move" not in found.outcome
