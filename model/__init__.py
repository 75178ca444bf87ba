"""The mechanics of tendon-driven arms: arms, scenes, and the shapes that they settle to."""

from octoplan.model.anchorage import Anchorage, Material, RestCurvature
from octoplan.model.arm import Arm, conical
from octoplan.model.compliance import LengthResponse, length_response
from octoplan.model.extensions.batches import Shapes, settle_many
from octoplan.model.paths import Linear, PiecewiseLinear, Sampled
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.stiffness import tip_jacobian
from octoplan.model.support.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    ShapeWarning,
    SnapError,
)
from octoplan.model.support.units import UnitWarning

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
    "PiecewiseLinear",
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
