"""The mechanics of tendon-driven arms: arms, scenes, and the shapes that they settle to."""

from octoplan.model.anchorage import Anchorage, Material, RestCurvature
from octoplan.model.arm import Arm
from octoplan.model.extensions.batches import settle_many
from octoplan.model.paths import Linear, PiecewiseLinear, Sampled
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.stiffness import tip_jacobian
from octoplan.model.support.errors import (
    InputError,
    OctoplanError,
    SnapError,
)

__all__ = [
    "Anchorage",
    "Arm",
    "InputError",
    "Linear",
    "Material",
    "OctoplanError",
    "PiecewiseLinear",
    "RestCurvature",
    "Sampled",
    "Scene",
    "Shape",
    "SnapError",
    "settle",
    "settle_many",
    "tip_jacobian",
]
