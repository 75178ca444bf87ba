"""The mesh of an arm that may touch obstacles, before its nodes move."""

from __future__ import annotations

from functools import partial

import numpy as np

from model.arm import Arm
from model.loads import contacts, growth, places
from model.mesh import Mesh, graded
from model.obstacles import numbers_of
from model.paths import Array
from model.scene import Scene

# Elements of a mesh over those of one without contact, and how long the longest may be: a share of
# the arm's length, or of obstacle and arm together, but no shorter than a share of the length.
_FINER, _LONGEST, _SHORTEST = 2, 1 / 16, 1 / 100


def mesh_with_contact(arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...]) -> Mesh:
    """Return the mesh of a refinement that has the arc lengths `at` as nodes."""
    own = (*at, *places(arm, scene))
    return graded(arm, _FINER * refinement, own, partial(_density, arm, scene))


def _density(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return how fast solutions may grow, or contact may change, at s (N,) [1/m]."""
    bodies = numbers_of([contact.obstacle for contact in contacts(scene)])
    small = float((bodies[:, 15] + bodies[:, 12:15].min(axis=1)).min())
    wide = np.maximum(small + arm.outer_radius(s)[0], _SHORTEST * arm.length)
    return np.maximum(growth(arm, scene, s), 0.75 / np.minimum(wide, _LONGEST * arm.length))
