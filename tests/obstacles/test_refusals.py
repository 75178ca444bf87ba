"""Invalid obstacles and impossible clearances are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Linear, Scene
from octoplan.model.effects import Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Mesh, Sphere
from octoplan.model.support.units import UnitWarning
from octoplan.planner import plan
from octoplan.planner.frontends.io.scene_file import read
from octoplan.planner.targets import TipPosition
from tests.obstacles.test_plans_around import FILE
from tests.refusals import Refused, check_refusal

ARM, SCENE, TARGET = Arm.from_paper("table-4"), Scene(Extension()), TipPosition((0.3, 0.12, -0.12))
# Discs reach farther out than the body, which would be clear of a ball beside the target.
DISCS = replace(ARM, hull=Linear(0.03, 0.01))
BESIDE = Sphere((0.3, 0.12, -0.1), 0.012)
CORNERS = 0.1 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
BOX = Mesh(CORNERS, FACES)
BODIES: list[tuple[Callable[[], object], str]] = [
    (lambda: Sphere((0, 0, 0), 0.0), "Sphere.radius"),
    (lambda: Sphere((0, 0, 0), np.nan), "Sphere.radius"),
    (lambda: Sphere((0, np.nan, 0), 0.1), "Sphere.center"),
    (lambda: Capsule((0, 0, 0), (0, 0, 0), 0.1), "Capsule.end"),
    (lambda: Capsule((0, 0, 0), (0, 0, 1), -0.1), "Capsule.radius"),
    (lambda: Box((0, 0, 0), (0.1, 0.0, 0.1)), "Box.size"),
    (lambda: Box((0, 0, 0), (0.1, 0.1, 0.1), ((1, 0, 0),) * 3), "Box.frame"),
    (lambda: HalfSpace((0, 0, 0), (0, 0, 0)), "HalfSpace.normal"),
]
MESHES: list[tuple[Any, Any, str]] = [
    (CORNERS, FACES[1:], "watertight"),
    (CORNERS, FACES[:, ::-1], "turned inwards"),
    (CORNERS, np.vstack([FACES[:1, ::-1], FACES[1:]]), "turned over"),
    (np.where(np.arange(8)[:, None] == 3, np.nan, CORNERS), FACES, "finite"),
    (CORNERS, np.vstack([FACES, [[0, 0, 1]]]), "have an area"),
    (CORNERS, FACES + 1, "numbers of vertices"),
    (CORNERS, FACES - 1, "numbers of vertices"),
    (CORNERS, FACES + 0.5, "whole numbers"),
    (CORNERS, FACES[:2], "at least 4"),
    (CORNERS[:, :2], FACES, "n x 3 numbers"),
    (0 * CORNERS, FACES, "have an area"),
]
ASKED: list[tuple[dict[str, Any], str, str]] = [
    ({"obstacles": [1.0]}, "obstacles[0]", ""),
    ({"obstacles": 3}, "obstacles", ""),
    ({"obstacles": [Sphere((0, 0, 0.01), 0.01)]}, "obstacles[0]", "base"),
    ({"obstacles": [Sphere(TARGET.position, 0.01)]}, "obstacles[0]", "tip at its target"),
    ({"clearance": -1e-3}, "clearance", ""),
    ({"clearance": np.nan}, "clearance", ""),
    ({"clearance": 1e-3}, "clearance", ""),
    ({"self_clearance": 2}, "self_clearance", ""),
]
MESH = '\n[[obstacles]]\ntype = "mesh"\n'
FILES: list[tuple[str, str, str, str]] = [
    ('20\n[[obstacles]]\ntype = "box"', '0\n[[obstacles]]\ntype = "box"', "obstacles[1].rad", ""),
    ("center_mm = [150, 0, 50]", "center_mm = [0, 0, 0]", "obstacles", ""),
    ("clearance_mm = 2", "clearance_mm = -2", "clearance_mm", ""),
    ("normal = [0, 0, 1]", "normal = [0, 0, 0]", "obstacles[3]", ""),
    ("normal = [0, 0, 1]", f"normal = [0, 0, 1]{MESH}file = 'none.stl'", "", "cannot be read"),
    (
        "normal = [0, 0, 1]",
        f"normal = [0, 0, 1]{MESH}vertices_mm = [[0, 0, 0]]",
        "",
        "vertices_mm and faces",
    ),
    ("normal = [0, 0, 1]", f"normal = [0, 0, 1]{MESH}", "", "a file, or"),
]
REFUSED: Refused = {
    **{f"{field} {i}": (make, field, "") for i, (make, field) in enumerate(BODIES)},
    **{f"mesh {i}": (partial(Mesh, v, f), "Mesh", told) for i, (v, f, told) in enumerate(MESHES)},
    **{
        str(given): (partial(plan, ARM, TARGET, SCENE, 20.0, **given), f, t)
        for given, f, t in ASKED
    },
    **{
        f"file, {new}": (partial(read, FILE.decode().replace(old, new, 1).encode()), field, told)
        for old, new, field, told in FILES
    },
    "a disc at the tip in a ball": (
        partial(plan, DISCS, TARGET, SCENE, 20.0, obstacles=[BESIDE]),
        "obstacles[0]",
        "would be 2 mm too near",
    ),
    "contact with a mesh": (lambda: Contact(BOX), "Contact", "not a Mesh"),  # type: ignore[arg-type]
    "a mesh in km": (lambda: Mesh.read(Path("a.stl"), "km"), "", "one of m, cm, mm, in"),
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_obstacle_is_refused_by_name(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


def test_meshes_in_other_units_are_warned_of_and_files_without_triangles_told(
    tmp_path: Path,
) -> None:
    with pytest.warns(UnitWarning, match="unit='mm'"):
        Mesh(1e3 * CORNERS, FACES)
    (tmp_path / "a.stl").write_text("nothing")
    check_refusal(lambda: Mesh.read(tmp_path / "a.stl", "mm"), "a.stl", "no triangles")
