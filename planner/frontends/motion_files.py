"""Files of motions: tables of tensions and lengths over time, and animations."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from octoplan.planner.frontends.io.csv_files import motion_csv
from octoplan.planner.frontends.io.files import path_of, write_named


def save_trajectory(motion: Any, path: str | Path) -> Path:
    """Write a Trajectory to a .csv file, or an animation to .gif or .mp4; see Trajectory.save."""
    path = path_of(path)
    if path.suffix.lower() not in (".gif", ".mp4"):
        return write_named(path, ".csv", motion_csv(motion))
    # Only animations need matplotlib.
    plots = import_module("octoplan.planner.frontends.plots.motion")
    plots.writer_of(path)
    written: Path = plots.save_motion(plots.animate_trajectory(motion), path)
    return written
