"""Obstacles: bodies with a signed distance, from which an arm keeps clear."""

from octoplan.model.extensions.obstacles.base import (
    Obstacle,
    check_obstacles,
    convex_parameters,
    distances,
)
from octoplan.model.extensions.obstacles.convex import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.mesh import Mesh
from octoplan.model.extensions.obstacles.moving import Moving

__all__ = [
    "Box",
    "Capsule",
    "HalfSpace",
    "Mesh",
    "Moving",
    "Obstacle",
    "Sphere",
    "check_obstacles",
    "convex_parameters",
    "distances",
]
