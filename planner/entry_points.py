"""Entry points of the extensions and front ends: dotted paths, imported when a call needs them.

The planner imports no extension. A target or an effect names the strategy that plans it
(`plan_strategy`).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_EXTENSIONS = "octoplan.planner.extensions"
_FRONTENDS = "octoplan.planner.frontends"

# Planning strategies, see octoplan.planner.plan.
STRATEGIES = {
    "avoidance": f"{_EXTENSIONS}.avoidance.strategy:AvoidanceStrategy",
    "contact": f"{_EXTENSIONS}.contact.strategy:ContactStrategy",
}

# Functions of problem, shape and midline that return fields of the certificate: for all scenes, and
# by the `plan_strategy` of an effect.
CERTIFICATE_CHECKS = {
    "": f"{_EXTENSIONS}.avoidance.checks:clearance_fields",
    "contact": f"{_EXTENSIONS}.contact.checks:complementarity_fields",
}

BASE_JOINTS = f"{_EXTENSIONS}.base_joints.placement:placed"
WARM_START = f"{_EXTENSIONS}.warm_start:warm_start"
JUMP = f"{_EXTENSIONS}.warm_start:jump"
MIRROR_IMAGES = f"{_EXTENSIONS}.mirror:mirror_images"
SAVE_PLAN = f"{_FRONTENDS}.io.saved_records:save_plan"
SAVE_CALIBRATION = f"{_FRONTENDS}.io.saved_records:save_calibration"
PLOT_CALIBRATION = f"{_FRONTENDS}.plots.results:plot_calibration"
SAVE_TRAJECTORY = f"{_FRONTENDS}.motion_files:save_trajectory"
LOAD_WAYPOINTS = f"{_FRONTENDS}.io.csv_files:load_waypoints"
PLAN = "octoplan.planner.plan:plan"


def load(path: str) -> Any:
    """Import the module of an entry point and return its function or class."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
