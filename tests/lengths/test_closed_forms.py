"""Settles by lengths against closed forms by hand."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.extensions.friction import Friction
from octoplan.model.tendons import rest_lengths
from tests.lengths.cases import EXACT, check_complementary, cylinder

R, Y, L, E = 8e-3, 4e-3, 0.2, 2e5
EA, EJ = E * np.pi * R**2, E * np.pi * R**4 / 4
BARE = Scene(ExactTendons())


def test_one_tendon_bends_an_inextensible_arm_into_an_arc() -> None:
    """l = L (1 - y k): the lengths determine the curvature, E J k = T y the tension."""
    arm, taken = cylinder((L,)), 6e-3
    shape = settle(arm, scene=BARE, lengths=[L - taken, L + 1, L + 1, L + 1], accuracy=1e-10)
    k = taken / L / Y
    assert shape.tensions == pytest.approx([EJ * k / Y, 0, 0, 0], rel=1e-9)
    assert shape.slack.tolist() == [[False, True, True, True]]
    want = [np.sin(k * L) / k, -(1 - np.cos(k * L)) / k, 0]
    assert shape.tip == pytest.approx(want, abs=1e-9 * L)
    check_complementary(shape)


def test_one_tendon_of_an_extensible_arm_shortens_it_as_well() -> None:
    """With c parallel to t: E A (1 - lambda) = T, E J kappa = T y, l = L (lambda - y kappa)."""
    arm, taken = cylinder((L,)), 6e-3
    shape = settle(arm, scene=EXACT, lengths=[L + 1, L - taken, L + 1, L + 1], accuracy=1e-10)
    T = taken / L / (1 / EA + Y**2 / EJ)
    assert shape.tensions == pytest.approx([0, T, 0, 0], rel=1e-9)
    kappa, stretch = T * Y / EJ, 1 - T / EA
    want = [stretch * np.sin(kappa * L) / kappa, 0, -stretch * (1 - np.cos(kappa * L)) / kappa]
    assert shape.tip == pytest.approx(want, abs=1e-9 * L)


def test_tendons_that_stretch_are_springs_in_series() -> None:
    arm, taken, own, outside = cylinder((L,)), 6e-3, 300.0, 0.5
    left = L - taken
    lengths, options = [left, L + 1, L + 1, L + 1], {"tendon_EA": own, "tendon_outside": outside}
    shape = settle(arm, scene=EXACT, lengths=lengths, accuracy=1e-10, **options)
    T = taken / (L * (1 / EA + Y**2 / EJ) + (left + outside) / own)
    assert shape.tensions[0] == pytest.approx(T, rel=1e-9)
    assert shape.tendon_lengths[0] == pytest.approx(left + T * (left + outside) / own, abs=1e-12)


def test_two_sections_in_a_plane() -> None:
    """The longer tendon bends both sections, the shorter one the first: two linear equations."""
    L1, L2 = 0.12, 0.2
    arm = cylinder((L2, L1))
    far, near, away = 5e-3, 2e-3, 1.0
    lengths = np.array([[L2 - far, 0, 0, 0], [0, 0, L1 - near, 0]])
    lengths[lengths == 0] = away
    shape = settle(arm, scene=EXACT, lengths=lengths, accuracy=1e-10)
    a, b = 1 / EA + Y**2 / EJ, 1 / EA - Y**2 / EJ
    T = np.linalg.solve([[L2 * a, L1 * b], [L1 * b, L1 * a]], [far, near])
    assert np.all(T > 0)
    assert shape.tensions[[0, 6]] == pytest.approx(T, rel=1e-9)
    k, stretch = (T[0] - T[1]) * Y / EJ, 1 - (T[0] + T[1]) / EA
    k2, stretch2 = T[0] * Y / EJ, 1 - T[0] / EA
    bend = k * L1 + k2 * (L2 - L1)
    along = stretch * np.sin(k * L1) / k + stretch2 * (np.sin(bend) - np.sin(k * L1)) / k2
    aside = stretch * (1 - np.cos(k * L1)) / k + stretch2 * (np.cos(k * L1) - np.cos(bend)) / k2
    assert shape.tip == pytest.approx([along, -aside, 0], abs=1e-9 * L2)


def test_a_tendon_of_its_own_length_lets_the_other_go_slack() -> None:
    """Two tendons on one side: the one that is a little too long is slack, by just that much."""
    arm = Arm(L, Linear(R, R), (Anchorage(L, Linear(Y, Y), (0.0, 0.0)),), Material(E))
    shape = settle(arm, scene=EXACT, lengths=[L - 5e-3, L - 5e-3 + 1e-6])
    assert shape.slack.tolist() == [[False, True]]
    assert shape.slack_lengths is not None
    assert shape.slack_lengths[1] == pytest.approx(1e-6, abs=1e-11)


def test_tendons_against_each_other_pull_the_least() -> None:
    """On a straight inextensible arm, lengths do not determine T1 = T3: the result is 0."""
    arm = cylinder((L,))
    shape = settle(arm, scene=BARE, lengths=[L, L, L, L])
    # Rounding of the lengths, over the smallest compliance of winches.
    assert np.all(shape.tensions <= 1e-4)
    assert set(shape.undetermined) == {"T_11", "T_12", "T_13", "T_14"}
    bent = settle(arm, scene=BARE, lengths=[L - 4e-3, L, L + 4e-3, L])
    k = 4e-3 / L / Y
    assert bent.tensions == pytest.approx([EJ * k / Y, 0, 0, 0], abs=1e-4)
    assert {"T_11", "T_13"} <= {*bent.undetermined}
    firm = settle(arm, scene=BARE, lengths=[L - 4e-3, L, L + 4e-3, L], tendon_EA=1e3)
    assert firm.undetermined == ()


def test_least_tensions_are_shared_by_equal_tendons() -> None:
    arm = Arm(L, Linear(R, R), (Anchorage(L, Linear(Y, Y), (0.0, 0.0)),), Material(E))
    shape = settle(arm, scene=EXACT, lengths=[L - 5e-3, L - 5e-3])
    T = 5e-3 / L / (1 / EA + Y**2 / EJ)
    assert shape.tensions == pytest.approx([T / 2, T / 2], rel=1e-5)
    assert set(shape.undetermined) == {"T_11", "T_12"}


def test_a_tendon_holds_a_column_that_would_buckle() -> None:
    """Above the critical load the arm leans until the tendon on the other side is taut."""
    arm = cylinder((L,))
    P = 1.5 * np.pi**2 / 4 * EJ / L**2
    scene = Scene(ExactTendons(), TipLoad((-P, 0.0, 0.0)))
    shape = settle(arm, scene=scene, lengths=[L - 2e-3, L, L + 2e-3, L])
    check_complementary(shape)
    assert shape.stability < 0


def test_friction_takes_what_the_motor_pulls_more() -> None:
    """An arc of theta: T(s) = T0 exp(-mu k s), and the shape must have the given lengths."""
    arm, mu = cylinder((L,)), 0.3
    lengths = [L - 6e-3, L + 1, L + 1, L + 1]
    smooth = settle(arm, scene=BARE, lengths=lengths, accuracy=1e-6)
    rough = settle(arm, scene=Scene(ExactTendons(), Friction(mu)), lengths=lengths, accuracy=1e-6)
    assert rough.tendon_lengths[0] == pytest.approx(L - 6e-3, abs=1e-9)
    # E J k(s) = y T0 exp(-mu theta(s)), theta' = k: exp(mu theta) = 1 + mu y T0 s / E J.
    T = (np.exp(mu * 6e-3 / Y) - 1) * EJ / (mu * Y * L)
    assert rough.tensions[0] == pytest.approx(T, rel=1e-5)
    assert rough.tensions[0] > smooth.tensions[0]


def test_some_by_length_and_some_by_tension() -> None:
    arm, T2 = cylinder((L,)), 0.3
    nan, away = np.nan, L + 1
    shape = settle(arm, [nan, nan, T2, nan], EXACT, 1e-10, lengths=[L - 2e-3, away, None, away])
    assert shape.tensions[2] == T2
    a, b = 1 / EA + Y**2 / EJ, 1 / EA - Y**2 / EJ
    assert shape.tensions[0] == pytest.approx((2e-3 / L - b * T2) / a, rel=1e-9)
    assert shape.slack.tolist() == [[False, True, False, True]]


def test_lengths_at_rest_take_no_tension_at_all() -> None:
    arm = Arm.from_paper("table-2")
    shape = settle(arm, scene=Scene(ExactTendons()), lengths=rest_lengths(arm))
    assert not shape.tensions.any()


@pytest.mark.quick("paper")
@pytest.mark.parametrize("scene", [Scene(Extension()), EXACT], ids=["paper", "exact"])
def test_a_tendon_is_as_long_as_the_curve_through_its_holes(scene: Scene) -> None:
    """Chords between u + y (n cos + b sin) with tapered offsets: twice as many err by a quarter."""
    arm, T = Arm.from_paper("table-4"), np.zeros(12)
    T[[2, 5, 10]] = 0.3, 1.0, 2.0
    shape = settle(arm, T, scene, 1e-10)
    for j, ((section, angle), path) in enumerate(zip(arm.tendons, arm.offset_of, strict=True)):
        end, sums = arm.sections[section].at, []
        for count in (400, 800):
            s = np.linspace(0, end, count + 1)
            y = arm.offset_paths[path][1].evaluate(s, end)[0][:, None]
            _, n, b = np.moveaxis(shape.frame(s), 2, 0)
            x = shape.position(s) + y * (n * np.cos(angle) + b * np.sin(angle))
            sums.append(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
        length = sums[1] + (sums[1] - sums[0]) / 3
        assert shape.tendon_lengths.ravel()[j] == pytest.approx(length, abs=2e-8 * arm.length)
