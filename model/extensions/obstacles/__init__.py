"""Obstacles: bodies with a signed distance, from which an arm keeps clear."""

from octoplan.model.extensions.obstacles.convex import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.mesh import Mesh
from octoplan.model.extensions.obstacles.moving import Moving

__all__ = [
    "Box",
    "Capsule",
    "HalfSpace",
    "Mesh",
    "Moving",
    "Sphere",
]
