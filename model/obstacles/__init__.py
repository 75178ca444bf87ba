"""Obstacles: bodies that an arm keeps clear of, by their signed distances."""

from model.obstacles.base import Obstacle, check_obstacles, distances, numbers_of
from model.obstacles.box import Box
from model.obstacles.capsule import Capsule
from model.obstacles.half_space import HalfSpace
from model.obstacles.mesh import Mesh
from model.obstacles.moving import Moving
from model.obstacles.sphere import Sphere

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
