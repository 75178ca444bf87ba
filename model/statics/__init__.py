"""The statics of a cross-section, one file for each form that the paper and physics give it."""

from model.statics.base import ClosedStatics, Statics
from model.statics.choice import statics_of

__all__ = ["ClosedStatics", "Statics", "statics_of"]
