"""Targets: the shapes that an arm can be asked for, one small file each."""

from planner.targets.backbone import Backbone
from planner.targets.base import Target, Terms, View
from planner.targets.bending_plane import BendingPlane
from planner.targets.fetch import Bend, Fetch, FetchReach
from planner.targets.hold import Hold
from planner.targets.stiffness import MinimumStiffness, Softest, Stiffest
from planner.targets.tip import TipPointing, TipPose, TipPosition
from planner.targets.wrap import Wrap

__all__ = [
    "Backbone",
    "Bend",
    "BendingPlane",
    "Fetch",
    "FetchReach",
    "Hold",
    "MinimumStiffness",
    "Softest",
    "Stiffest",
    "Target",
    "Terms",
    "TipPointing",
    "TipPose",
    "TipPosition",
    "View",
    "Wrap",
]
