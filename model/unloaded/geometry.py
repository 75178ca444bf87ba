"""What a closed form needs of an arm's geometry on a mesh, that other arms share.

Those of another material, or of another radius of about the same taper.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.integrators.magnus import Magnus
from model.mesh import Mesh, graded, roughly
from model.paths import Array
from model.stations import Counts, base_pose, stations
from model.unloaded.statics import ClosedStatics

# E A, E J and G I come first among the data of a cross-section.
_BODY = 3


class Geometry:
    """An arm whatever it is made of: equal to another of the same tendons and taper.

    Attributes
    ----------
    arm : Arm
    taper : Path
        What its meshes are graded for.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self.taper = arm, roughly(arm.radius)
        body = (arm.length, self.taper, arm.sections, arm.rest_curvature)
        self._key = (*body, arm.base_frame, arm.base_position)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Geometry) and self._key == other._key


@dataclass(frozen=True, eq=False)
class GeometryOnMesh:
    """The places of a closed form on a mesh, and the numbers of its geometry there.

    Attributes
    ----------
    at : (K,)
        Arc lengths: a scheme's nodes in the steps, then both ends of each segment [m].
    active : (K,)
        How many sections' tendons cross there.
    maps : (K, n_pull, n_tendons)
        From tensions to pull.
    others : (K, n_data - 3)
        What of the data is no stiffness of the body.
    base, h : (7,), (S,)
        Pose of the base, lengths of the steps [m].
    """

    mesh: Mesh
    at: Array
    active: Counts
    maps: Array
    others: Array
    base: Array
    h: Array

    def data(self, arm: Arm) -> Array:
        """Return the data (K, n_data) of an arm of this geometry."""
        E, G, R = arm.material.E, arm.material.G, arm.radius.evaluate(self.at, arm.length)[0]
        area = np.pi * R**2
        J = area * R**2 / 4
        return np.hstack([np.array([E * area, E * J, 2 * G * J]).T, self.others])


@lru_cache(maxsize=64)
def geometry_on_mesh(
    geometry: Geometry,
    statics: ClosedStatics,
    scheme: Magnus,
    refinement: int,
    at: tuple[float, ...],
) -> GeometryOnMesh:
    """Return the places on a mesh of a refinement that has the arc lengths `at` as nodes."""
    arm, m = geometry.arm, len(scheme.nodes)
    mesh = graded(arm, refinement, at, taper=geometry.taper)
    ends, at_ends = mesh.segment_ends()
    s = np.concatenate([nodes_of(scheme, mesh.s[:-1], mesh.s[1:]), ends])
    active = np.concatenate([np.repeat(mesh.active, m), at_ends])
    there = stations(arm, s, active)
    maps, others = statics.pulls(arm, there), statics.data(there)[_BODY:].T
    return GeometryOnMesh(mesh, s, active, maps, others, base_pose(arm), np.diff(mesh.s))


def nodes_of(scheme: Magnus, left: Array, right: Array) -> Array:
    """Return the arc lengths (m N,) of a scheme's nodes in N steps."""
    return np.ravel(left[:, None] + (right - left)[:, None] * np.array(scheme.nodes))
