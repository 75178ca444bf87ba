"""The mechanics of tendon-driven arms: arms, scenes, and the shapes that they settle to."""

from model.anchorage import Anchorage, Material, RestCurvature
from model.arm import Arm, conical
from model.compliance import LengthResponse, length_response
from model.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    ShapeWarning,
    SnapError,
)
from model.many import Shapes, settle_many
from model.paths import Linear, Sampled
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.stiffness import tip_jacobian
from model.units import UnitWarning
from octoplan_packages import warn_of_hidden

warn_of_hidden("planner")

__all__ = [
    "Anchorage",
    "Arm",
    "CollapsedError",
    "ConvergenceError",
    "InputError",
    "LengthResponse",
    "Linear",
    "Material",
    "OctoplanError",
    "RestCurvature",
    "Sampled",
    "Scene",
    "Shape",
    "ShapeWarning",
    "Shapes",
    "SnapError",
    "UnitWarning",
    "conical",
    "length_response",
    "settle",
    "settle_many",
    "tip_jacobian",
]
