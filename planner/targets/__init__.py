"""Targets: requirements on the shape of an arm, one small file each."""

from octoplan.planner.targets.backbone import Backbone
from octoplan.planner.targets.base import Target
from octoplan.planner.targets.bending_plane import BendingPlane
from octoplan.planner.targets.fetch import Bend, Fetch, FetchReach
from octoplan.planner.targets.stiffness import MinimumStiffness, Softest, Stiffest
from octoplan.planner.targets.tip import TipPointing, TipPose, TipPosition

__all__ = [
    "Backbone",
    "Bend",
    "BendingPlane",
    "Fetch",
    "FetchReach",
    "MinimumStiffness",
    "Softest",
    "Stiffest",
    "Target",
    "TipPointing",
    "TipPose",
    "TipPosition",
]
