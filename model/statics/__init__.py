"""The statics of a cross-section without loads, in closed form and as printed."""

from model.statics.base import ClosedStatics, Statics
from model.statics.choice import statics_of

__all__ = ["ClosedStatics", "Statics", "statics_of"]
