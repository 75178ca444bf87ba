"""Tensions to shape to lengths to shape: the same arm; random lengths settle, or have no shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, Shape, settle
from octoplan.model.effects import Extension
from octoplan.model.loads import is_coupled
from octoplan.model.support.errors import CollapsedError
from octoplan.model.tendons import rest_lengths
from tests.lengths.cases import EXACT, PAPER, SCENES, check_complementary, pulled, round_trip

_ARMS = ("table-2", "table-4", "random")


@pytest.mark.quick("inextensible", "in water")
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_lengths_of_a_shape_give_it_back(scene: Scene) -> None:
    check_trips(scene, 1, 1 if is_coupled(Arm.from_paper("table-4"), scene) else 3, 1)


# The coarse mesh left a billionth of a slack tendon's spare length. The tendon and its antagonists
# then pulled, which lengths do not determine, and missed their lengths permanently.
def test_a_tendon_that_is_slack_by_little_keeps_no_other_from_its_length() -> None:
    arm = Arm.from_paper("table-2")
    T = np.array([0.23, 0.02, 0.07, 0.48, 0.51, 0.94, 0.13, 0.3, 1.61, 1.11, 1.47, 0.0])
    given = settle(arm, T, EXACT, 1e-9)
    back = settle(arm, scene=EXACT, accuracy=1e-9, lengths=given.tendon_lengths + 1.6e-6 * (T == 0))
    check_complementary(back)
    assert np.linalg.norm(back.tip - given.tip) < 1e-8 * arm.length
    assert np.array_equal(np.ravel(back.slack), T == 0)


# The lengths were refused as too short, with the name of lengths that do not crush the arm.
@pytest.mark.slow
def test_lengths_are_met_where_the_least_energy_is_no_guess() -> None:
    arm, scene = Arm.from_paper("table-4"), PAPER["paper in water"]
    lengths = rest_lengths(arm) * np.append(0.69, np.ones(11))
    shape = settle(arm, scene=scene, accuracy=1e-4, lengths=lengths)
    check_complementary(shape)
    assert shape.strain(shape.s)[:, 3].min() > -0.9


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_lengths_of_many_shapes_give_them_back(scene: Scene) -> None:
    check_trips(scene, 42, 126, 2)


def check_trips(scene: Scene, least: int, tries: int, seed: int) -> None:
    """Assert round trips over the paper's arms and random ones."""
    rng, found = np.random.default_rng(seed), 0
    for i in range(tries):
        arm, T = pulled(rng, _ARMS[i % 3])
        trip = round_trip(rng, arm, T, scene)
        if trip is None:
            continue
        given, back = trip
        assert np.array_equal(np.ravel(back.slack), T == 0)
        check_complementary(back)
        if np.linalg.norm(back.tip - given.tip) > 1e-8 * arm.length:
            assert back.undetermined
            check_least(given, back)
        firm = [j for j in range(T.size) if arm.tendon_name(j) not in back.undetermined]
        assert np.abs(back.tensions - T)[firm].max(initial=0) <= 1e-4 * T.max(initial=1e-9)
        found += 1
    assert found >= least


@pytest.mark.parametrize("scene", PAPER.values(), ids=PAPER)
def test_lengths_are_met_where_there_is_no_energy(scene: Scene) -> None:
    rng = np.random.default_rng(3)
    arm, T = pulled(rng, "table-2")
    trip = round_trip(rng, arm, T, scene, 1e-7)
    assert trip is not None
    check_complementary(trip[1])


def test_lengths_are_met_far_from_the_least_energy_of_what_has_a_potential() -> None:
    """Refused as too short: the paper's tangent is far from the initial guess of the search."""
    arm, scene = Arm.from_paper("table-4"), Scene(Extension())
    T = np.array([0, 0, 0, 0, 1.15, 0.04, 0, 0, 2.81, 0, 1.62, 1.54])
    shape = settle(arm, T, scene, 1e-8)
    spare = np.where(T > 0, 0.0, 2e-3)
    back = settle(arm, lengths=shape.tendon_lengths + spare, scene=scene, accuracy=1e-8)
    assert np.linalg.norm(back.tip - shape.tip) < 1e-8 * arm.length
    check_complementary(back)


# With the paper's tangent, antagonists that lengths do not determine change the shape. Steps along
# these tensions ended a settle as a snap, or drifted to tensions above the least.
@pytest.mark.parametrize("seed", [9, 42])
def test_undetermined_tensions_are_the_least_and_meet_the_lengths(seed: int) -> None:
    rng = np.random.default_rng((7, seed))
    arm, T = pulled(rng, "table-2")
    trip = round_trip(rng, arm, T, PAPER["paper in water"], 1e-9)
    assert trip is not None
    assert trip[1].undetermined
    check_least(*trip)


def check_least(given: Shape, back: Shape) -> None:
    """Assert that another shape has the same lengths to rounding, by lower tensions.

    Settle these tensions to a thousandth of the accuracy, because meshes may differ.
    """
    T, arm = np.ravel(given.tensions), given.arm
    assert np.linalg.norm(back.tensions) <= 1.001 * np.linalg.norm(T)
    assert np.abs(back.tendon_lengths - given.tendon_lengths)[T > 0].max() <= 1e-13 * arm.length
    same, again = (settle(arm, pulls, given.scene, 1e-9) for pulls in (T, back.tensions))
    off = np.abs(again.tendon_lengths - same.tendon_lengths)[T > 0]
    assert off.max() <= 1e-12 * arm.length


# Tendons whose effect differs by 1e-4 from antagonists of another section were reported as
# determined; lengths of a last step were 7e-12 L off.
@pytest.mark.parametrize(
    "T",
    [
        [0.087, 0.068, 0.0174, 0.0121, 0.358, 0.62, 0.701, 0, 0.251, 0.779, 1.126, 1.176],
        [0.0449, 0, 0.0462, 0.0228, 0.267, 0.693, 0.235, 0.472, 0, 0, 0, 0],
        [0, 0.0801, 0.0817, 0, 0, 0, 0.14, 0, 1.456, 1.494, 1.395, 1.66],
    ],
)
def test_all_tensions_that_lengths_do_not_determine_are_told(T: list[float]) -> None:
    arm, scene = Arm.from_paper("table-4"), PAPER["paper"]
    given = settle(arm, T, scene, 1e-9)
    back = settle(arm, scene=scene, lengths=given.tendon_lengths + 1e-3 * (np.array(T) == 0))
    firm = [j for j in range(12) if arm.tendon_name(j) not in back.undetermined]
    assert np.abs(back.tensions - T)[firm].max() <= 1e-6
    check_least(given, back)


# A tendon within a billionth of its winch's length kept its antagonist from the given length; a
# step that ended with a slack tendon counted as the last.
@pytest.mark.parametrize(
    ("seed", "name", "share"), [(0, "inextensible", 0.2), (20, "paper in water", 0.4)]
)
def test_lengths_between_those_of_two_shapes_are_met(seed: int, name: str, share: float) -> None:
    rng, arms = np.random.default_rng((4, seed)), {0: "table-2", 20: "table-4"}
    scene = {**SCENES, **PAPER}[name]
    arm, T = pulled(rng, arms[seed])
    one, other = (
        settle(arm, t, scene).tendon_lengths for t in (T, T * rng.uniform(0.5, 1.5, T.size))
    )
    lengths = (1 - share) * one + share * other + (T == 0) * 1e-3
    check_complementary(settle(arm, scene=scene, lengths=lengths))


# Undetermined tensions stayed unchanged although one of the tendons had to become slack.
def test_a_tendon_slackens_by_tensions_that_no_length_feels() -> None:
    rng = np.random.default_rng((7, 190))
    arm, T = pulled(rng, "random")
    trip = round_trip(rng, arm, T, SCENES["in water"])
    assert trip is not None
    check_complementary(trip[1])
    assert np.array_equal(np.ravel(trip[1].slack), T == 0)
    assert trip[1].tip == pytest.approx(trip[0].tip, abs=1e-9 * arm.length)


# Damping hid a nearly undetermined combination of tensions from the undetermined ones: it drifted,
# and a settle of 50 ms took two minutes of load steps. Rounding kept steps from ending at 3e-4 L.
@pytest.mark.parametrize("more", [0.0, 1e-6])
def test_weakly_felt_tensions_do_not_drift_under_loads(
    more: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, scene = Arm.from_paper("table-4"), PAPER["paper in water"]
    T = [6.1e-4, 0.0586, 0.0837, 0.0736, 0.553, 0.0148, 0.109, 0.107, 1.69, 0, 0.541, 0.947]
    given = settle(arm, (1 + more) * np.array(T), scene)
    steps: list[Any] = []
    monkeypatch.setattr(
        "octoplan.model.equilibrium.continuation.report", lambda *said: steps.append(said)
    )
    back = settle(arm, scene=scene, lengths=given.tendon_lengths + 1e-3 * (np.array(T) == 0))
    assert len(steps) <= 4
    # Lengths to rounding determine these tensions to about 1e-3 N, which moves the tip by 3e-6 L.
    assert np.linalg.norm(back.tip - given.tip) <= 5e-6 * arm.length
    check_complementary(back)


@pytest.mark.quick("scene1-table-2", "scene2-table-4")
@pytest.mark.parametrize("name", ["table-2", "table-4"])
@pytest.mark.parametrize("scene", [EXACT, Scene.silicone(), Scene(*EXACT.effects[1:])])
def test_random_strokes_settle(name: str, scene: Scene) -> None:
    check_strokes(Arm.from_paper(name), scene, 3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table-2", "table-4"])
@pytest.mark.parametrize("scene", ["exact", "silicone", "in water", "current"])
def test_many_random_strokes_settle(name: str, scene: str) -> None:
    check_strokes(Arm.from_paper(name), SCENES[scene], 125)


def check_strokes(arm: Arm, scene: Scene, count: int) -> None:
    """Assert that lengths within 15 % of those at rest settle, or are refused with a reason."""
    rng, rest = np.random.default_rng(5), rest_lengths(arm)
    for _ in range(count):
        lengths = rest * (1 + rng.uniform(-0.15, 0.15, rest.size))
        try:
            shape = settle(arm, scene=scene, accuracy=1e-4, lengths=lengths)
        except (CollapsedError, InputError) as refusal:
            assert "crushed" in str(refusal) or "no shape" in str(refusal)
            continue
        check_complementary(shape)
