"""Signed distances of obstacles, against closed forms and points on their surfaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle, convex_parameters, distances
from octoplan.planner.frontends.bodies.surface import outline
from tests.oracles import Array

coal = pytest.importorskip("coal")
trimesh = pytest.importorskip("trimesh")

_TURNED = np.linalg.qr(np.array([[1.0, 2, 0], [0, 1, 3], [2, 0, 1]]))[0]
ROUND: dict[str, Obstacle] = {
    "sphere": Sphere((0.1, -0.02, 0.05), 0.03),
    "capsule": Capsule((0.1, -0.05, 0.0), (0.2, 0.08, -0.1), 0.02),
    "box": Box((0.1, 0.05, -0.02), (0.06, 0.1, 0.03), tuple(map(tuple, _TURNED.tolist()))),
    "half-space": HalfSpace((0.0, 0.0, -0.2), (1.0, 2.0, 4.0)),
}


def _points(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-0.3, 0.4, (count, 3))


def _geometry(name: str) -> tuple[object, Array, Array]:
    """Return an obstacle in coal's terms: shape, frame and place."""
    obstacle = ROUND[name]
    if isinstance(obstacle, Sphere):
        return coal.Sphere(obstacle.radius), np.eye(3), np.array(obstacle.center)
    if isinstance(obstacle, Capsule):
        a, b = np.array(obstacle.start), np.array(obstacle.end)
        z = (b - a) / np.linalg.norm(b - a)
        x = np.cross([0.0, 0, 1], z)
        x /= np.linalg.norm(x)
        frame = np.column_stack([x, np.cross(z, x), z])
        return coal.Capsule(obstacle.radius, float(np.linalg.norm(b - a))), frame, (a + b) / 2
    if isinstance(obstacle, Box):
        return coal.Box(*obstacle.size), np.array(obstacle.frame), np.array(obstacle.center)
    assert isinstance(obstacle, HalfSpace)
    normal = np.array(obstacle.normal)
    return coal.Halfspace(normal, float(normal @ obstacle.point)), np.eye(3), np.zeros(3)


@pytest.mark.parametrize("name", ROUND)
def test_distances_are_those_of_coal(name: str, deviation: Callable[..., float]) -> None:
    shape, frame, place = _geometry(name)
    points = _points(300)
    found = ROUND[name].distance(points)
    tiny = 1e-4
    for point, distance in zip(points, found, strict=True):
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        at, ball = coal.Transform3s(frame, place), coal.Transform3s(np.eye(3), point)
        other = coal.distance(shape, at, coal.Sphere(tiny), ball, request, result) + tiny
        assert deviation(distance, other) < 2e-6


def test_distances_inside_and_outside_of_a_box_are_those_of_trimesh() -> None:
    box = ROUND["box"]
    assert isinstance(box, Box)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = box.frame, box.center
    if np.linalg.det(pose[:3, :3]) < 0:
        pose[:3, 0] *= -1
    mesh = trimesh.creation.box(box.size, pose)
    points = np.vstack([_points(200), np.array(box.center) + 0.03 * _points(100, 1)])
    found = box.distance(points)
    _, away, _ = trimesh.proximity.closest_point_naive(mesh, points)
    np.testing.assert_allclose(np.abs(found), away, atol=1e-9)
    inside = np.abs((points - box.center) @ np.array(box.frame)) < np.array(box.size) / 2
    np.testing.assert_array_equal(found < 0, inside.all(axis=1))


@pytest.mark.parametrize("name", ROUND)
def test_derivatives_are_those_of_differences(name: str) -> None:
    points, step = _points(200, 2), 1e-6
    obstacle = ROUND[name]
    ends = [obstacle.distance(points + s * step * e) for e in np.eye(3) for s in (1, -1)]
    ahead, behind = np.array(ends[::2]), np.array(ends[1::2])
    differences = ((ahead - behind) / (2 * step)).T
    np.testing.assert_allclose(obstacle.gradient(points), differences, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(obstacle.gradient(points), axis=1), 1, atol=1e-12)


def test_numbers_are_finite_where_there_is_no_derivative() -> None:
    at = {"sphere": (0.1, -0.02, 0.05), "capsule": (0.15, 0.015, -0.05), "box": (0.1, 0.05, -0.02)}
    for name, center in at.items():
        assert ROUND[name].distance(center) < 0
        assert np.isfinite(ROUND[name].gradient(center)).all()


@pytest.mark.parametrize("name", ROUND)
def test_outlines_lie_on_the_surface(name: str) -> None:
    points, triangles = outline(ROUND[name])
    assert np.abs(ROUND[name].distance(points)).max() < 1e-12
    assert triangles.max() < len(points)


def test_many_obstacles_at_once_are_as_each_alone() -> None:
    points = _points(20)
    found, gradients = distances(convex_parameters(list(ROUND.values())), points)
    for k, obstacle in enumerate(ROUND.values()):
        np.testing.assert_array_equal(found[:, k], obstacle.distance(points))
        np.testing.assert_array_equal(gradients[:, k], obstacle.gradient(points))


START, END, RADIUS = np.array([0.1, -0.05, 0.0]), np.array([0.2, 0.08, -0.1]), 0.02
FRAME = np.linalg.qr(np.array([[1.0, 2, 0], [0, 1, 3], [2, 0, 1]]))[0]
CENTER, SIZE = np.array([0.1, 0.05, -0.02]), np.array([0.06, 0.1, 0.03])
POINTS = np.random.default_rng(3).uniform(-0.3, 0.4, (400, 3))


def to_segment(points: np.ndarray) -> np.ndarray:
    along = END - START
    share = np.clip((points - START) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - START - share[:, None] * along, axis=1) - RADIUS


def to_box(points: np.ndarray) -> np.ndarray:
    beyond = np.abs((points - CENTER) @ FRAME) - SIZE / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.parametrize(
    ("obstacle", "wanted"),
    [
        (Sphere(tuple(START), RADIUS), np.linalg.norm(POINTS - START, axis=1) - RADIUS),
        (Capsule(tuple(START), tuple(END), RADIUS), to_segment(POINTS)),
        (
            HalfSpace(tuple(START), (1.0, 2.0, 2.0)),
            (POINTS - START) @ np.array([1.0, 2.0, 2.0]) / 3,
        ),
        (Box(tuple(CENTER), tuple(SIZE), tuple(map(tuple, FRAME.tolist()))), to_box(POINTS)),
    ],
    ids=["sphere", "capsule", "half-space", "box"],
)
def test_distances_are_those_of_closed_forms(obstacle: Obstacle, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(obstacle.distance(POINTS), wanted, rtol=0, atol=1e-12)
