"""Drawings of the page, by viser: the arm on the base, tendons, obstacles and the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.rotations import from_matrix
from octoplan.model.shape import Shape
from octoplan.planner.frontends.bodies.surface import (
    along,
    outline,
    sketched_poses,
    surface,
    tendon_lines,
)
from octoplan.planner.plan_result import Plan

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Style:
    """Colours of the page (red, green, blue), and sizes relative to the arm length.

    Attributes
    ----------
    top, bottom : Colour
        Background gradient.
    line, coarse : Colour
        Grid lines of the floor.
    slack, low, high : Colour
        A slack tendon, a taut tendon at minimal tension, a tendon at maximal tension.
    body, ellipsoid, obstacle, plate : Colour
    thickness, aside : float
        Thickness of a tendon; distance of the label from the arm.
    largest : float
        Longest half axis of the ellipsoid.
    floor, wide : float
        Depth of the floor below the base; width.
    """

    top: Colour
    bottom: Colour
    line: Colour
    coarse: Colour
    slack: Colour = (128, 134, 145)
    low: Colour = (240, 150, 20)
    high: Colour = (200, 0, 60)
    body: Colour = (35, 95, 170)
    ellipsoid: Colour = (90, 160, 90)
    obstacle: Colour = (190, 105, 30)
    plate: Colour = (70, 78, 90)
    thickness: float = 5e-3
    aside: float = 0.065
    largest: float = 0.15
    floor: float = 0.6
    wide: float = 1.6


LIGHT = Style((203, 216, 230), (238, 242, 246), (176, 188, 202), (120, 134, 152))
DARK = Style((22, 27, 36), (48, 56, 68), (70, 80, 95), (120, 132, 150))


def picture(shape: Shape, most: Array) -> tuple[Any, ...]:
    """Return the geometry of a shape; tendons at `most` (n_tendons,) [N] have the colour `high`.

    Vertices (V, 3) of the surface [m] and triangles (F, 3); line segments of the tendons (P, 2, 3)
    [m] and the colours of the ends (P, 2, 3); positions of the tendon labels (n_tendons, 3) [m].
    """
    arm = shape.arm
    s = along(arm, 61)
    poses = sketched_poses(shape, s)
    lines = tendon_lines(arm, s, poses)
    pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
    tensions = zip(shape.tensions.tolist(), most.tolist(), strict=True)
    each = [tension_colour(tension, limit) for tension, limit in tensions]
    colours = np.repeat(np.array(each, np.uint8), [len(piece) for piece in pieces], axis=0)
    ends = np.array([line[-1] for line in lines])
    out = ends - poses[np.searchsorted(s, [arm.sections[i].at for i, _ in arm.tendons]), 4:]
    aside = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
    names = ends + LIGHT.aside * arm.length * aside
    both = np.repeat(colours[:, None], 2, axis=1)
    return *surface(arm, s, poses, 24), np.vstack(pieces), both, names


def tension_colour(tension: float, most: float) -> Colour:
    """Return the colour of a tension from 0 to `most` [N], linear in the square root."""
    if tension <= 1e-6 * most:
        return LIGHT.slack
    share = min(tension / most, 1.0) ** 0.5
    r, g, b = (round(a + share * (z - a)) for a, z in zip(LIGHT.low, LIGHT.high, strict=True))
    return r, g, b


def draw_surroundings(server: Any, arm: Arm, style: Style) -> None:
    """Draw the base plate, and a floor with a scale in mm.

    Shadows are off: shadows took 75 % of the frame time without a graphics card.
    """
    server.scene.configure_default_lights(cast_shadow=False)
    R = arm.base_radius
    frame = np.array(arm.base_frame)
    thickness = 0.02 * arm.length
    server.scene.add_cylinder(
        "/base",
        2.4 * R,
        thickness,
        style.plate,
        radial_segments=48,
        wxyz=from_matrix(frame[:, [1, 2, 0]]),  # axis z of the cylinder along t
        position=np.array(arm.base_position) - thickness / 2 * frame[:, 0],
    )
    _draw_floor(server.scene, arm, style)


def _draw_floor(scene: Any, arm: Arm, style: Style) -> None:
    """Draw a grid below the arm, with coordinates in mm along two edges."""
    L = arm.length
    base = np.array(arm.base_position)
    coarse = 0.1 * max(1, round(L / 0.5))
    half = coarse * np.ceil(style.wide * L / 2 / coarse)
    ahead = base + 0.4 * L * np.array(arm.base_frame)[:, 0]
    centre = np.round(ahead[:2] / coarse) * coarse
    hanging = -float(np.array(arm.base_frame)[2, 0]) > 0.5
    z = float(base[2] - (1.1 if hanging else style.floor) * L)
    scene.add_grid(
        "/floor",
        2 * half,
        2 * half,
        cell_size=coarse / 2,
        section_size=coarse,
        cell_color=style.line,
        section_color=style.coarse,
        position=(*centre, z),
        fade_distance=100 * L,
    )
    for axis, name in enumerate("xy"):
        # The common corner of both edges has a label of the first edge only.
        for k in np.arange(-half, half + coarse / 2 - axis * coarse, 2 * coarse):
            place = centre.copy()
            place[axis] += k
            place[1 - axis] += half if axis == 0 else -half
            message = f"{name} {1e3 * place[axis]:.0f} mm"
            at = (*place.tolist(), z)
            scene.add_label(f"/scale/{name}{k:.3f}", message, position=at, font_screen_scale=0.75)


def backdrop(style: Style) -> str:
    """Return HTML with the background gradient; an image would cost a render pass per frame."""
    top = f"rgb{style.top}"
    bottom = f"rgb{style.bottom}"
    return f"<style>canvas[data-engine] {{ background: linear-gradient({top}, {bottom}) }}</style>"


def set_camera(server: Any, arm: Arm) -> None:
    """Set the initial view: the arm from the side, z up."""
    middle = np.array(arm.base_position) + 0.4 * arm.length * np.array(arm.base_frame)[:, 0]
    server.scene.set_up_direction("+z")
    away = arm.length * np.array([0.3, -0.75, 0.2])
    server.initial_camera.position = tuple((middle + away).tolist())
    server.initial_camera.look_at = tuple((middle - [0.0, 0.0, 0.12 * arm.length]).tolist())


class ArmOnPage:
    """An arm with tendons and labels; created once, then updated."""

    def __init__(self, server: Any, shape: Shape, most: Array) -> None:
        """Draw a shape; tendons at `most` (n_tendons,) [N] have the colour `high`."""
        vertices, faces, pieces, colours, names = picture(shape, most)
        scene = server.scene
        arm = shape.arm
        self._server = server
        self._body = scene.add_mesh_simple("/body", vertices, faces, color=LIGHT.body, opacity=0.45)
        thick = LIGHT.thickness * arm.length
        self._tendons = scene.add_line_segments("/tendons", pieces, colours, thickness=thick)
        style = {"anchor": "center-center", "font_screen_scale": 0.7}
        self._names = [
            scene.add_label(f"/labels/{name}", name, position=place, **style)
            for name, place in zip(arm.tendon_names, names, strict=True)
        ]

    def move(self, shape: Shape, most: Array, named: bool) -> None:
        """Update the drawing to another shape, with or without labels of the tendons."""
        vertices, _, pieces, colours, names = picture(shape, most)
        with self._server.atomic():
            self._body.vertices = vertices
            self._tendons.points = pieces
            self._tendons.colors = colours
            for label, place in zip(self._names, names, strict=True):
                label.position = place
                label.visible = named


def add_obstacle(server: Any, name: str, obstacle: Obstacle) -> Any:
    """Draw an obstacle; return the handle of the mesh."""
    points, triangles = outline(obstacle)
    return server.scene.add_mesh_simple(name, points, triangles, color=LIGHT.obstacle, opacity=0.6)


def draw_ellipsoid(server: Any, p: Plan, axes: Array, directions: Array) -> None:
    """Draw the compliance ellipsoid at the tip: half axes (3,) and directions (3, 3)."""
    size = LIGHT.largest * p.arm.length * np.maximum(axes / axes[0], 1e-3)
    server.scene.add_icosphere(
        "/ellipsoid",
        1.0,
        LIGHT.ellipsoid,
        scale=tuple(size.tolist()),
        wxyz=from_matrix(directions * np.sign(np.linalg.det(directions))),
        position=p.shape.tip,
        opacity=0.4,
    )
