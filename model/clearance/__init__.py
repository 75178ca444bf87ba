"""How far a settled arm stays from obstacles, from behind its base and from itself."""

from model.clearance.nearest import Clearance, clearance, clearance_of, clearances, rough_gaps

__all__ = ["Clearance", "clearance", "clearance_of", "clearances", "rough_gaps"]
