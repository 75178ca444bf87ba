"""What a page shows of a plan, by viser: arm and tendons, ellipsoid, tensions as bars."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from model.arm import Arm
from model.obstacles import Obstacle
from model.paths import Array
from model.rotations import from_matrix
from model.shape import Shape
from planner.live.tube import picture, tension_colour
from planner.plan import Plan

_BODY, _ELLIPSOID, _OBSTACLE = (178, 196, 214), (90, 160, 90), (181, 101, 29)
# The width of a tendon, and the ellipsoid's longest half axis, over the arm's length.
_THICK, _SEEN = 4e-3, 0.15
# Where the camera is from the arm's middle, in arm lengths.
_VIEW = np.array([0.2, -1.0, 0.45])


def set_camera(server: Any, arm: Arm) -> None:
    """Look at the arm from the side; z is up."""
    middle = np.array(arm.base_position) + 0.5 * arm.length * np.array(arm.base_frame)[:, 0]
    server.scene.set_up_direction("+z")
    server.initial_camera.position = tuple((middle + arm.length * _VIEW).tolist())
    server.initial_camera.look_at = tuple(middle.tolist())


def draw_arm(server: Any, shape: Shape, most: Array) -> None:
    """Draw an arm and its tendons; `most` (n_tendons,) are those of the last colour [N]."""
    seen, scene = picture(shape, most), server.scene
    with server.atomic():
        scene.add_mesh_simple("/body", seen.vertices, seen.faces, color=_BODY, opacity=0.3)
        thickness = _THICK * shape.arm.length
        scene.add_line_segments("/tendons", seen.tendons, seen.colours, thickness=thickness)


def add_obstacle(server: Any, name: str, obstacle: Obstacle) -> Any:
    """Draw an obstacle; return what is drawn, to be hidden."""
    points, triangles = obstacle.outline
    return server.scene.add_mesh_simple(name, points, triangles, color=_OBSTACLE, opacity=0.4)


def draw_ellipsoid(server: Any, p: Plan, axes: Array, directions: Array) -> None:
    """Draw the compliance ellipsoid at the tip: half axes (3,) and their directions (3, 3)."""
    size = _SEEN * p.arm.length * np.maximum(axes / axes[0], 1e-3)
    server.scene.add_icosphere(
        "/ellipsoid",
        1.0,
        _ELLIPSOID,
        scale=tuple(size.tolist()),
        wxyz=from_matrix(directions * np.sign(np.linalg.det(directions))),
        position=p.shape.tip,
        opacity=0.4,
    )


def bars(p: Plan, most: Array) -> str:
    """Return the tensions as bars against their limits, as HTML."""
    rows = []
    for j, (T, limit) in enumerate(zip(np.ravel(p.tensions), most, strict=True)):
        colour = "rgb" + str(tension_colour(float(T), float(limit)))
        width = 100 * min(float(T / limit), 1.0)
        rows.append(
            f"<div>{html.escape(p.arm.tendon_name(j))} {T:.2f} N"
            f"<div style='background:#ddd'><div style='background:{colour};height:5px;"
            f"width:{width:.1f}%'></div></div></div>"
        )
    return f"<div style='font-size:11px;padding:0 1em'>{''.join(rows)}</div>"
