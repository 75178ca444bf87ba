"""Warnings that point at the line of the caller's script, however deep they are raised."""

from __future__ import annotations

import sys
import warnings
from types import FrameType

_OURS = frozenset({"model", "planner", "octoplan", "octoplan_packages"})


# What stands between a script and what it calls.
_BETWEEN = frozenset({"model.progress", "model.settle", "model.warn"})


def called_by_a_script() -> bool:
    """Return whether a public call is a script's, and no part of another call of ours."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "") in _BETWEEN:
        frame = frame.f_back
    return frame is None or frame.f_globals.get("__name__", "").split(".")[0] not in _OURS


def warn(message: str, category: type[Warning]) -> None:
    """Warn as of the nearest line that is not this project's."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
