"""Warnings that point at the line of the caller's script, however deep they are raised."""

from __future__ import annotations

import sys
import warnings
from types import FrameType

_OURS = frozenset({"model", "planner", "octoplan", "octoplan_packages"})


def warn(message: str, category: type[Warning]) -> None:
    """Warn as of the nearest line that is not this project's."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
