"""How far a settled arm stays from obstacles, from behind its base and from itself."""

from octoplan.model.extensions.clearance.nearest import KINDS, Clearance, clearance, clearances

__all__ = ["KINDS", "Clearance", "clearance", "clearances"]
