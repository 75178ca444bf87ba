"""The picture of a shape in numbers: the surface of the body, and the tendons on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.paths import Array
from model.rotations import matrices
from model.shape import Shape
from model.stations import tendon_offset
from planner.bodies.surface import surface

_ALONG, _AROUND = 61, 24
# Of a slack tendon, of one at the least, and of one at the most tension, red green blue.
SLACK, LOW, HIGH = (150, 155, 165), (240, 150, 20), (200, 0, 60)


@dataclass(frozen=True, eq=False)
class Picture:
    """What is drawn of a shape.

    Attributes
    ----------
    vertices : (V, 3)
        Of the body's surface [m]; `faces` (F, 3) tells which three make each triangle.
    tendons : (P, 2, 3)
        Pieces of the tendons from point to point [m].
    colours : (P, 2, 3)
        Of their ends, by tension.
    """

    vertices: Array
    faces: NDArray[np.int64]
    tendons: Array
    colours: NDArray[np.uint8]


def picture(shape: Shape, most: Array) -> Picture:
    """Return the picture of a shape; tendons at `most` (n_tendons,) [N] have the last colour."""
    s = np.linspace(0.0, shape.arm.length, _ALONG)
    poses = shape.poses(s)
    places, frames = poses[:, 4:], matrices(poses[:, :4])
    pieces, colours = _tendons(shape, s, places, frames, most)
    return Picture(*surface(shape.arm, s, poses, _AROUND), pieces, colours)


def tension_colour(tension: float, most: float) -> tuple[int, int, int]:
    """Return the colour of a tension between nothing and the most [N], by its square root."""
    if tension <= 1e-6 * most:
        return SLACK
    share = min(tension / most, 1.0) ** 0.5
    r, g, b = (round(a + share * (z - a)) for a, z in zip(LOW, HIGH, strict=True))
    return r, g, b


def _tendons(
    shape: Shape, s: Array, places: Array, frames: Array, most: Array
) -> tuple[Array, NDArray[np.uint8]]:
    """Return the pieces of the tendons along u + y d, eqs. (5), (6), and their colours."""
    pieces, colours = [], []
    for j, (i, _) in enumerate(shape.arm.tendons):
        inside = s <= shape.arm.sections[i].at
        off = tendon_offset(shape.arm, j, s[inside])
        path = places[inside] + np.einsum("nij,nj->ni", frames[inside][:, :, 1:], off)
        pieces.append(np.stack([path[:-1], path[1:]], axis=1))
        colour = tension_colour(float(shape.tensions[j]), float(most[j]))
        colours.append(np.broadcast_to(np.array(colour, np.uint8), pieces[-1].shape))
    return np.vstack(pieces), np.vstack(colours)
