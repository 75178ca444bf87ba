"""Meshes as obstacles: distances against trimesh and closed forms, bounds, plans, files."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.extensions.clearance import clearance
from octoplan.model.extensions.obstacles import Box, Mesh, Moving, Sphere
from octoplan.planner import plan, trajectory
from octoplan.planner.frontends.bodies.surface import outline
from octoplan.planner.frontends.io.saved_files import load_plan
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.targets import TipPosition
from tests.core.model.cases import paper_tensions

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("igl")
ARM, SCENE = Arm.from_paper("table-4"), Scene(Extension())
TARGET = TipPosition((0.30, 0.15, -0.10))


def mesh_of(found: object) -> Mesh:
    """Return the mesh of one of trimesh."""
    return Mesh(found.vertices, found.faces)  # type: ignore[attr-defined]


def ring(place: tuple[float, ...] = (0.2, 0.05, 0.0), wide: float = 0.05) -> Mesh:
    """Return a torus, which is far from convex, about the first axis."""
    found = trimesh.creation.torus(wide, 0.015, major_sections=24, minor_sections=12)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    return mesh_of(found.apply_transform(turn).apply_translation(place))


def dented() -> Mesh:
    """Return a box with a sharp notch: edges and corners that point inwards."""
    profile = [(0, 0), (0.1, 0), (0.1, 0.08), (0.06, 0.02), (0.03, 0.08), (0, 0.08)]
    n, (x, y) = len(profile), np.array(profile).T
    vertices = np.vstack([np.column_stack([x, y, np.full(n, z)]) for z in (0.0, 0.05)])
    cap = [(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)]
    sides = [(i, (i + 1) % n, (i + 1) % n + n) for i in range(n)]
    sides += [(i, (i + 1) % n + n, i + n) for i in range(n)]
    faces = [(a, c, b) for a, b, c in cap] + [(a + n, b + n, c + n) for a, b, c in cap] + sides
    return Mesh(tuple(map(tuple, vertices.tolist())), tuple(faces))


@pytest.mark.parametrize("mesh", [ring(), dented()], ids=["ring", "dented"])
def test_distances_are_those_of_trimesh(mesh: Mesh) -> None:
    other = trimesh.Trimesh(*outline(mesh), process=False)
    low, high = other.bounds
    points = np.random.default_rng(0).uniform(low - 0.03, high + 0.03, (400, 3))
    _, away, _ = trimesh.proximity.closest_point_naive(other, points)
    found = mesh.distance(points)
    np.testing.assert_allclose(np.abs(found), away, atol=1e-12)
    # Winding numbers by solid angles (Van Oosterom, Strackee 1983), apart from any normal.
    a, b, c = (other.triangles[None, :, i] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    dots = [np.einsum("kmi,kmi->km", *pair) for pair in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    winding = np.arctan2(np.einsum("kmi,kmi->km", a, np.cross(b, c)), below).sum(axis=1) / 2 / np.pi
    np.testing.assert_array_equal(found < 0, winding > 0.5)
    assert 20 < (found < 0).sum() < 380


def test_a_mesh_of_a_box_is_that_box() -> None:
    box = Box((0.1, 0.05, -0.02), (0.06, 0.1, 0.03))
    mesh = mesh_of(trimesh.creation.box(box.size).apply_translation(box.center))
    assert mesh.is_convex
    points = np.random.default_rng(1).uniform(-0.1, 0.2, (500, 3))
    np.testing.assert_allclose(mesh.distance(points), box.distance(points), atol=1e-12)
    np.testing.assert_allclose(mesh.gradient(points), box.gradient(points), atol=1e-9)


@pytest.mark.parametrize("mesh", [ring(), dented()], ids=["ring", "dented"])
def test_derivatives_are_those_of_differences(mesh: Mesh) -> None:
    assert not mesh.is_convex
    low, high = outline(mesh)[0].min(axis=0), outline(mesh)[0].max(axis=0)
    points, step = np.random.default_rng(2).uniform(low - 0.05, high + 0.05, (300, 3)), 1e-7
    ends = [mesh.distance(points + s * step * e) for e in np.eye(3) for s in (1, -1)]
    differences = ((np.array(ends[::2]) - np.array(ends[1::2])) / (2 * step)).T
    smooth = np.linalg.norm(differences, axis=1) > 1 - 1e-6  # two places equally near elsewhere
    assert smooth.mean() > 0.98
    np.testing.assert_allclose(mesh.gradient(points)[smooth], differences[smooth], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.gradient(points), axis=1), 1, atol=1e-12)


def test_the_certified_clearance_is_below_fine_samples_and_close_to_them() -> None:
    rng, mesh, near = np.random.default_rng(5), ring(), 0
    for _ in range(6):
        shape = settle(ARM, paper_tensions(rng, "table-4"), SCENE)
        found = clearance(shape, [mesh])
        s = np.linspace(0, ARM.length, 4001)
        gaps = mesh.distance(shape.position(s)) - ARM.radius.evaluate(s, ARM.length)[0]
        assert found.gap <= gaps.min() + 1e-9
        if found.what == "obstacles[0]":
            near += 1
            assert found.gap >= gaps.min() - max(1e-4, 0.02 * abs(gaps.min()))
    assert near > 2


@pytest.mark.parametrize("unit", [1.0, 0.2])
def test_a_plan_leads_around_a_mesh_as_around_the_body(unit: float) -> None:
    ball = Sphere((0.27, 0.06, -0.06), 0.03)
    found = trimesh.creation.icosphere(subdivisions=3, radius=ball.radius)
    mesh = mesh_of(found.apply_translation(ball.center))
    clear = 0.002 * unit
    body, other = (
        plan(ARM, TARGET, SCENE, 20.0, obstacles=[own], clearance=clear) for own in (ball, mesh)
    )
    assert body.reached and other.reached
    assert body.effort > 1.1 * plan(ARM, TARGET, SCENE, 20.0).effort  # the mesh obstructs the arm
    assert other.certificate.clearance >= clear
    # The mesh is inside of the ball by up to 0.2 mm.
    assert other.effort == pytest.approx(body.effort, rel=0.02)


def test_a_motion_keeps_clear_of_a_mesh_that_moves() -> None:
    places = [(0.30, 0.12, -0.12), (0.25, 0.15, -0.18)]
    mesh = ring((0.3, -0.12, -0.05))
    moving = Moving(mesh, (0.0, 2.0), ((0, 0, 0), (0, 0.04, 0)))
    found = trajectory(
        ARM, [TipPosition(x) for x in places], SCENE, 20.0, rate_max=5.0, obstacles=[moving]
    )
    assert found.certificate.passed
    for t in np.linspace(0, found.duration, 15):
        shape, body = found.shape(float(t)), moving.at(float(t))
        s = np.linspace(0, ARM.length, 400)
        gaps = body.distance(shape.position(s)) - ARM.radius.evaluate(s, ARM.length)[0]
        assert gaps.min() > 0


def test_files_of_meshes_are_read_in_their_unit_and_place(tmp_path: Path) -> None:
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    for name in ("a.stl", "a.obj", "a.ply"):
        box.export(tmp_path / name)
        turned = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
        mesh = Mesh.read(tmp_path / name, "mm", (0.1, 0.2, 0.3), turned)
        assert len(mesh.faces) == 12
        np.testing.assert_allclose(np.ptp(outline(mesh)[0], axis=0), (0.03, 0.02, 0.04), atol=1e-7)
        np.testing.assert_allclose(outline(mesh)[0].mean(axis=0), (0.1, 0.2, 0.3), atol=1e-7)
    box.invert()
    box.export(tmp_path / "inverted.stl")
    assert Mesh.read(tmp_path / "inverted.stl", "mm").distance((0, 0, 0)) < 0
    assert pickle.loads(pickle.dumps(mesh)) == mesh
    assert len(repr(mesh)) < 120


SCENE_FILE = """
clearance_mm = 2.0
[arm]
preset = "table-4"
[effects]
extension = true
[limits]
tension_max = 20.0
[target]
type = "tip-position"
position_mm = [300.0, 150.0, -100.0]
[[obstacles]]
type = "mesh"
"""


def test_scene_files_and_plans_hold_meshes(tmp_path: Path) -> None:
    trimesh.creation.box((20.0, 30.0, 40.0)).export(tmp_path / "thing.stl")
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE_FILE + 'file = "thing.stl"\nposition_mm = [200.0, 150.0, 100.0]\n')
    found = load(scene).options["obstacles"][0]
    assert isinstance(found, Mesh)
    p = plan(ARM, TARGET, SCENE, 20.0, obstacles=[found], clearance=0.002)
    p.save(tmp_path / "plan.json")
    assert load_plan(tmp_path / "plan.json").problem.environment.obstacles == (found,)
