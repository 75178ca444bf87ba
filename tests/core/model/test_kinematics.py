"""Rotations, poses and Magnus steps against matrix exponentials."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from octoplan.model.rod.collocation import MAGNUS4, MAGNUS6, Magnus
from octoplan.model.rotations import (
    compose,
    exponential,
    from_matrix,
    inverse,
    matrices,
    matrix,
    rotate,
)
from tests.oracles import Array, twist_matrix

ANGLES = (0.0, 1e-12, 1e-6, 0.0999, 0.1001, 0.999, 1.001, 3.0, 6.5)
AXES = np.array([[1, 0, 0], [0, -1, 0], [2, -1, 2], [-1, 3, 5]])
SHIFT = np.array([0.3, -0.7, 0.2])
QUICK = settings(max_examples=40, deadline=None, derandomize=True)

w, v, p, q = (ca.SX.sym(name, n) for name, n in (("w", 3), ("v", 3), ("p", 7), ("q", 7)))
EXP = ca.Function("exponential", [w, v], [exponential(w, v)])
SLOPE = ca.Function("slope", [w, v], [ca.jacobian(exponential(w, v), ca.vertcat(w, v))])
WEIGHTS = np.arange(1, 8)
CURVE = ca.Function(
    "curve", [w, v], [ca.hessian(ca.dot(WEIGHTS, exponential(w, v)), ca.vertcat(w, v))[0]]
)


IDENTITY = (1.0, *[0.0] * 6)
COMPOSE = ca.Function("compose", [p, q], [compose(p, q)])
INVERSE = ca.Function("inverse", [p], [inverse(p)])
TWIST, H = ca.SX.sym("twist", 6), ca.SX.sym("h")

unit = arrays(float, 4, elements=st.floats(-1, 1)).filter(lambda x: np.linalg.norm(x) > 0.1)
place = arrays(float, 3, elements=st.floats(-2, 2))


def values(x: ca.DM) -> Array:
    return np.array(x).squeeze()


def turn(angle: float, axis: Array) -> Array:
    return angle * axis / np.linalg.norm(axis)


def homogeneous(pose: Array) -> Array:
    """Return the 4x4 matrix of a pose (7,)."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = matrices(pose[:4]), pose[4:]
    return result


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_is_that_of_the_twist_matrix(angle: float, axis: Array) -> None:
    pose = values(EXP(turn(angle, axis), SHIFT))
    wanted = expm(twist_matrix(turn(angle, axis), SHIFT))
    assert np.abs(homogeneous(pose) - wanted).max() <= 1e-14 * max(1, angle)
    assert abs(np.linalg.norm(pose[:4]) - 1) <= 1e-15


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("angle", ANGLES)
def test_derivative_of_the_exponential_is_finite_and_right(angle: float, axis: Array) -> None:
    x, h = np.concatenate([turn(angle, axis), SHIFT]), 1e-3
    wanted = np.zeros((7, 6))
    for i, step in enumerate(h * np.eye(6)):
        ends = [values(EXP(y[:3], y[3:])) for y in (x - 2 * step, x - step, x + step, x + 2 * step)]
        wanted[:, i] = np.array([1, -8, 8, -1]) @ ends / (12 * h)
    assert np.abs(np.array(SLOPE(x[:3], x[3:])) - wanted).max() <= 1e-11


@pytest.mark.parametrize("angle", ANGLES)
def test_second_derivative_of_the_exponential_is_finite_and_right(angle: float) -> None:
    x, h = np.concatenate([turn(angle, AXES[2]), SHIFT]), 1e-3
    wanted = np.zeros((6, 6))
    for i, step in enumerate(h * np.eye(6)):
        points = (x - 2 * step, x - step, x + step, x + 2 * step)
        ends = [WEIGHTS @ np.array(SLOPE(y[:3], y[3:])) for y in points]
        wanted[:, i] = np.array([1, -8, 8, -1]) @ ends / (12 * h)
    assert np.abs(np.array(CURVE(x[:3], x[3:])) - wanted).max() <= 1e-9


@QUICK
@given(unit, unit, unit, place, place, place)
def test_poses_form_a_group(p: Array, q: Array, r: Array, x: Array, y: Array, z: Array) -> None:
    f, g, h = (np.append(a / np.linalg.norm(a), b) for a, b in ((p, x), (q, y), (r, z)))
    left = values(COMPOSE(COMPOSE(f, g), h))
    assert np.allclose(left, values(COMPOSE(f, COMPOSE(g, h))), rtol=0, atol=1e-14)
    assert np.allclose(homogeneous(left), homogeneous(f) @ homogeneous(g) @ homogeneous(h))
    assert np.array_equal(values(COMPOSE(f, IDENTITY)), f)
    assert np.array_equal(values(COMPOSE(IDENTITY, f)), f)
    for product in (COMPOSE(f, INVERSE(f)), COMPOSE(INVERSE(f), f)):
        assert np.allclose(values(product), IDENTITY, rtol=0, atol=1e-14)


@QUICK
@given(unit, place)
def test_a_quaternion_of_any_length_has_the_matrix_of_a_unit_one(a: Array, x: Array) -> None:
    wanted = Rotation.from_quat(np.roll(a, -1)).as_matrix()
    assert np.allclose(matrices(a), wanted, rtol=0, atol=1e-14)
    assert np.allclose(matrices(a).T @ matrices(a), np.eye(3), rtol=0, atol=1e-14)
    assert np.allclose(values(ca.evalf(matrix(ca.DM(a)))), wanted, rtol=0, atol=1e-14)
    single = a / np.linalg.norm(a)
    assert np.allclose(values(rotate(ca.DM(single), ca.DM(x))), wanted @ x, rtol=0, atol=1e-13)
    pose = np.append(single, x)
    assert np.allclose(homogeneous(values(COMPOSE(pose, INVERSE(pose)))), np.eye(4), atol=1e-13)


@pytest.mark.parametrize("scheme", [MAGNUS4, MAGNUS6], ids=lambda x: x.name)
def test_magnus_step_of_a_constant_twist_is_exact(scheme: Magnus) -> None:
    step = ca.Function("step", [TWIST, H], [scheme.step([TWIST] * len(scheme.nodes), H)])
    rng = np.random.default_rng(0)
    for spin, along, h in zip(*rng.uniform(-2, 2, (2, 40, 3)), rng.uniform(-2, 2, 40), strict=True):
        pose = values(step(np.concatenate([spin, along]), h))
        wanted = expm(h * twist_matrix(spin, along))
        assert np.abs(homogeneous(pose) - wanted).max() <= 1e-13


@QUICK
@given(unit)
def test_frames_survive_the_way_to_quaternions_and_back(a: Array) -> None:
    half_turns = (turn(np.pi, axis) for axis in (*np.eye(3), *AXES))
    for rotation in (Rotation.from_quat(np.roll(a, -1)), *map(Rotation.from_rotvec, half_turns)):
        frame = rotation.as_matrix()
        found = from_matrix(frame)
        assert np.abs(matrices(found) - frame).max() <= 1e-14
        assert abs(np.linalg.norm(found) - 1) <= 1e-14
        assert found[0] >= 0
