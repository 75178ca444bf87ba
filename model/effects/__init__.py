"""The effects that a scene can call for, one small file each."""

from model.effects.base import Effect
from model.effects.contact import Contact
from model.effects.current import Current
from model.effects.exact_tendons import ExactTendons
from model.effects.extension import Extension
from model.effects.friction import Friction
from model.effects.neo_hookean import NeoHookean
from model.effects.point_load import PointLoad
from model.effects.point_mass import PointMass
from model.effects.printed import PrintedStatics
from model.effects.self_contact import SelfContact
from model.effects.shear import Shear
from model.effects.tip_load import TipLoad
from model.effects.weight import Buoyancy, Weight

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
