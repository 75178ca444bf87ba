"""Covariance and undetermined directions of a straight cylinder against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan import Anchorage, Arm, Linear, Material, Scene, estimate_load, settle
from octoplan.model.effects import Extension
from octoplan.planner.extensions.load_estimate.estimate import LoadEstimate

L, R, E = 0.3, 0.006, 2e5
EJ = E * np.pi * R**4 / 4
EA = E * np.pi * R**2
GI = EJ / 1.5
STD = 1e-4
ARM = Arm(L, Linear(R, R), (Anchorage(L, Linear(0.005, 0.005)),), Material(E, 0.5))
NONE = np.zeros(4)
# n and b are minus y and minus z in the default base frame.
STRAIGHT = np.array([L, 0.0, 0.0])


def test_the_force_on_a_cantilever_has_the_std_of_its_stiffness() -> None:
    found = estimate_load(ARM, Scene(Extension()), NONE, tip=STRAIGHT, std=STD)
    across = 3 * EJ / L**3 * STD
    assert found.std[:3] == pytest.approx([EA / L * STD, across, across], rel=1e-5)
    assert found.covariance[:3, :3] == pytest.approx(np.diag(found.std[:3] ** 2), abs=1e-18)
    assert found.std[3:].tolist() == [0, 0, 0]
    assert (found.n_data, found.n_determined) == (3, 3)


def test_each_axis_may_have_its_own_std() -> None:
    stds = np.array([1e-4, 2e-4, 3e-4])
    found = estimate_load(ARM, Scene(Extension()), NONE, tip=STRAIGHT, std=stds)
    assert found.std[1:3] == pytest.approx(3 * EJ / L**3 * stds[1:], rel=1e-5)


def test_a_pose_determines_force_and_moment() -> None:
    angle = 2e-3
    pose = (STRAIGHT, np.diag([1.0, -1.0, -1.0]))
    found = estimate_load(ARM, Scene(Extension()), NONE, pose=pose, std=STD, angle_std=angle)
    # Displacement along y and rotation about z of a cantilever by force and moment.
    C = np.array([[L**3 / 3, L**2 / 2], [L**2 / 2, L]]) / EJ
    K = np.linalg.inv(C)
    wanted = K @ np.diag([STD**2, angle**2]) @ K.T
    assert found.covariance[np.ix_([1, 5], [1, 5])] == pytest.approx(wanted, rel=1e-5)
    assert found.std[3] == pytest.approx(GI / L * angle, rel=1e-5)


def test_noise_of_tensions_adds_to_the_covariance() -> None:
    pulls = np.full(4, 0.05)
    plain, noisy = (
        estimate_load(
            ARM,
            Scene(Extension()),
            pulls,
            tip=settle(ARM, pulls, Scene(Extension())).tip,
            std=STD,
            tension_std=noise,
        )
        for noise in (0.0, 1e-3)
    )
    # A tension T bends by T y / D, D = EJ + sum of T y^2, over the whole length: L^2 / 2 aside.
    D = EJ + 2 * 0.05 * 0.005**2
    q = 1 - pulls.sum() / EA
    aside = np.sqrt(2) * 1e-3 * 0.005 / D * (q * L) ** 2 / 2
    added = plain.std[1] * aside / STD
    assert noisy.std[1] == pytest.approx(np.hypot(plain.std[1], added), rel=1e-3)


def undetermined(scene: Scene, **more: object) -> LoadEstimate:
    return estimate_load(ARM, scene, NONE, std=STD, **more)  # type: ignore[arg-type]


def test_an_inextensible_straight_arm_does_not_feel_a_force_along_it() -> None:
    found = undetermined(Scene(), tip=STRAIGHT)
    assert found.std[0] == np.inf
    assert np.isfinite(found.std[1:3]).all()
    assert [each.names for each in found.undetermined] == [("force x",)]
    assert str(found.undetermined[0]) == "no measurement depends on force x"
    assert found.information[0] == pytest.approx(np.zeros(6), abs=1e-3 * found.information[1, 1])
    assert "Undetermined" in found.outcome
    assert found.force[0] == pytest.approx(0, abs=1e-12)
    assert found.holds([EA, 0, 0])


def test_a_tip_position_leaves_three_of_six_components() -> None:
    # Small: a larger deflection at constant x needs a force along the arm.
    aside = 1e-5 * L
    found = undetermined(Scene(Extension()), tip=[L, aside, 0], moment=True)
    assert (len(found.undetermined), found.n_determined) == (3, 3)
    assert np.isinf(found.std).tolist() == [False, True, True, True, True, True]
    # aside / L = f + m / 2 with f = F L^2 / (3 EJ), m = M L / EJ has the least norm (4, 2) / 5.
    assert found.force[1] == pytest.approx(0.8e-5 * 3 * EJ / L**2, rel=1e-5)
    assert found.moment[2] == pytest.approx(0.4e-5 * EJ / L, rel=1e-5)


def test_unseen_coordinates_are_left_out() -> None:
    place = np.array([L, np.nan, 0.0])
    found = undetermined(Scene(Extension()), points=[(L, (0, 0, 0), place)], moment=False)
    assert found.n_data == 2
    assert np.isinf(found.std[1])
    assert found.std[2] == pytest.approx(3 * EJ / L**3 * STD, rel=1e-5)
