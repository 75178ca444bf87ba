"""The statics of a cross-section, one file for each form that the paper and physics give it."""

from model.statics.base import ClosedStatics, Statics
from model.statics.choice import is_loaded, loaded_statics_of, statics_of
from model.statics.loaded import LoadedStatics

__all__ = [
    "ClosedStatics",
    "LoadedStatics",
    "Statics",
    "is_loaded",
    "loaded_statics_of",
    "statics_of",
]
