"""The tables of scene files: which keys they have, what these may be, and what they stand for."""

from planner.scenes.schema import scene_schema
from planner.scenes.tables import SceneTable

__all__ = ["SceneTable", "scene_schema"]
