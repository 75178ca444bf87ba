"""The effects that a scene can call for, one small file each."""

from octoplan.model.effects.base import Effect
from octoplan.model.effects.contact import Contact, Friction, SelfContact
from octoplan.model.effects.loads import Buoyancy, Current, PointLoad, PointMass, TipLoad, Weight
from octoplan.model.effects.sections import (
    ExactTendons,
    Extension,
    NeoHookean,
    PrintedStatics,
    Shear,
)

__all__ = [
    "Buoyancy",
    "Contact",
    "Current",
    "Effect",
    "ExactTendons",
    "Extension",
    "Friction",
    "NeoHookean",
    "PointLoad",
    "PointMass",
    "PrintedStatics",
    "SelfContact",
    "Shear",
    "TipLoad",
    "Weight",
]
