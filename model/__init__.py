"""The mechanics of tendon-driven arms: arms, scenes, and the shapes that they settle to."""

from model.anchorage import Anchorage
from model.arm import Arm, conical
from model.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    ShapeWarning,
    SnapError,
)
from model.jacobian import tip_jacobian
from model.length_response import LengthResponse, length_response
from model.many import settle_many
from model.material import Material
from model.paths import Linear, Sampled
from model.rest_curvature import RestCurvature
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.shapes import Shapes
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
