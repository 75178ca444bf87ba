"""Figures; nothing else in the project knows matplotlib, which is loaded with the first of them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.plots.calibration import plot_residuals
    from planner.plots.effects import plot_effects
    from planner.plots.motion import animate_trajectory, plot_motion, save_motion
    from planner.plots.plan import plot_plan, plot_shape
    from planner.plots.stiffness import plot_ellipsoids
    from planner.plots.strains import plot_strains
    from planner.plots.trajectory import plot_trajectory

__all__ = [
    "animate_trajectory",
    "plot_effects",
    "plot_ellipsoids",
    "plot_motion",
    "plot_plan",
    "plot_residuals",
    "plot_shape",
    "plot_strains",
    "plot_trajectory",
    "save_motion",
]

_FILES = {
    "animate_trajectory": "motion",
    "plot_effects": "effects",
    "plot_ellipsoids": "stiffness",
    "plot_motion": "motion",
    "plot_plan": "plan",
    "plot_residuals": "calibration",
    "plot_shape": "plan",
    "plot_strains": "strains",
    "plot_trajectory": "trajectory",
    "save_motion": "motion",
}


def __getattr__(name: str) -> Any:
    if name not in _FILES:
        raise AttributeError(f"module 'planner.plots' has no attribute {name!r}")
    return getattr(import_module(f"planner.plots.{_FILES[name]}"), name)
