"""Obstacles: bodies that an arm keeps clear of, by their signed distances."""

from octoplan.model.obstacles.base import Obstacle, check_obstacles, distances, numbers_of
from octoplan.model.obstacles.convex import Box, Capsule, HalfSpace, Sphere
from octoplan.model.obstacles.mesh import Mesh
from octoplan.model.obstacles.moving import Moving

__all__ = [
    "Box",
    "Capsule",
    "HalfSpace",
    "Mesh",
    "Moving",
    "Obstacle",
    "Sphere",
    "check_obstacles",
    "distances",
    "numbers_of",
]
