"""Figures. Only this folder imports matplotlib."""

from octoplan.planner.frontends.plots.ellipsoids import plot_ellipsoids
from octoplan.planner.frontends.plots.motion import (
    animate_trajectory,
    plot_motion,
    plot_trajectory,
    save_motion,
)
from octoplan.planner.frontends.plots.plan import plot_plan, plot_shape, plot_strains
from octoplan.planner.frontends.plots.results import (
    plot_accuracy,
    plot_check,
    plot_effects,
    plot_residuals,
)
from octoplan.planner.frontends.plots.workspace import plot_workspace

__all__ = [
    "animate_trajectory",
    "plot_accuracy",
    "plot_check",
    "plot_effects",
    "plot_ellipsoids",
    "plot_motion",
    "plot_plan",
    "plot_residuals",
    "plot_shape",
    "plot_strains",
    "plot_trajectory",
    "plot_workspace",
    "save_motion",
]
