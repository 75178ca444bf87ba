"""What a closed form needs of an arm's geometry on a mesh: another material shares all of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.integrators.magnus import Magnus
from model.mesh import Mesh, graded
from model.paths import Array
from model.stations import Counts, base_pose, stations
from model.unloaded.statics import ClosedStatics

# E A, E J and G I come first among the data of a cross-section.
_BODY = 3


class Geometry:
    """An arm whatever it is made of: equal to another of the same shape and tendons."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        body = (arm.length, arm.radius, arm.sections, arm.hull, arm.rest_curvature)
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
    radius : (K,)
        [m].
    others : (K, n_data - 3)
        What of the data is no stiffness of the body.
    base, h : (7,), (S,)
        Pose of the base, lengths of the steps [m].
    """

    mesh: Mesh
    at: Array
    active: Counts
    maps: Array
    radius: Array
    others: Array
    base: Array
    h: Array

    def data(self, arm: Arm) -> Array:
        """Return the data (K, n_data) of an arm of this geometry."""
        E, G = arm.material.E, arm.material.G
        area, J = np.pi * self.radius**2, np.pi * self.radius**4 / 4
        return np.column_stack([E * area, E * J, 2 * G * J, self.others])


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
    mesh = graded(arm, refinement, at)
    ends, at_ends = mesh.segment_ends()
    s = np.concatenate([nodes_of(scheme, mesh.s[:-1], mesh.s[1:]), ends])
    active = np.concatenate([np.repeat(mesh.active, m), at_ends])
    there, radius = stations(arm, s, active), arm.radius.evaluate(s, arm.length)[0]
    maps, others = statics.pulls(arm, there), statics.data(there)[_BODY:].T
    return GeometryOnMesh(mesh, s, active, maps, radius, others, base_pose(arm), np.diff(mesh.s))


def nodes_of(scheme: Magnus, left: Array, right: Array) -> Array:
    """Return the arc lengths (m N,) of a scheme's nodes in N steps."""
    return np.ravel(left[:, None] + (right - left)[:, None] * np.array(scheme.nodes))
