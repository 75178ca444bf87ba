"""Planning: targets, the nonlinear program, and plans that are checked."""

import octoplan.planner.frontends.report  # noqa: F401  (it tells how results are shown)
from octoplan.model.stiffness import stiffness
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.extensions.fit.calibrate import calibrate
from octoplan.planner.extensions.fit.design import design
from octoplan.planner.extensions.fit.manufacturing import ManufacturingLimits, Reach
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.unknowns import Unknown
from octoplan.planner.extensions.load_estimate.sensing import estimate_load
from octoplan.planner.extensions.tracking.tracker import Tracker
from octoplan.planner.extensions.trajectory.motion import trajectory
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.frontends.accuracy_study import accuracy_study
from octoplan.planner.frontends.arm_check import check_arm
from octoplan.planner.frontends.c_code.export import export
from octoplan.planner.frontends.effect_ablation import switch_effects
from octoplan.planner.frontends.io.saved_files import load_calibration, load_plan
from octoplan.planner.frontends.many import plan_many
from octoplan.planner.frontends.sweeps.sweep import sweep
from octoplan.planner.frontends.workspaces.workspace import workspace
from octoplan.planner.limits import Limits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan

__all__ = [
    "BaseJoints",
    "Limits",
    "ManufacturingLimits",
    "Measured",
    "Plan",
    "Reach",
    "Tracker",
    "Trajectory",
    "Unknown",
    "accuracy_study",
    "calibrate",
    "check_arm",
    "design",
    "estimate_load",
    "export",
    "load_calibration",
    "load_plan",
    "plan",
    "plan_many",
    "stiffness",
    "sweep",
    "switch_effects",
    "trajectory",
    "workspace",
]
