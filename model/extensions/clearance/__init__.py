"""Clearance of a settled arm from obstacles, from the space behind its base, and from itself."""

from octoplan.model.extensions.clearance.nearest import KINDS, Clearance, clearance, clearances

__all__ = ["KINDS", "Clearance", "clearance", "clearances"]
