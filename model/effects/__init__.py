"""The effects of the model core, which a scene may contain."""

from octoplan.model.effects.loads import (
    Buoyancy,
    Current,
    LineLoad,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.effects.sections import ExactTendons, Extension, NeoHookean, Shear

__all__ = [
    "Buoyancy",
    "Current",
    "ExactTendons",
    "Extension",
    "LineLoad",
    "NeoHookean",
    "PointLoad",
    "PointMass",
    "Shear",
    "TipLoad",
    "Weight",
]
