"""Planning: targets, the nonlinear program, and plans that are checked."""

import octoplan.planner.report  # noqa: F401  (it tells how results are shown)
from octoplan.model.stiffness import stiffness
from octoplan.planner.bodies.files import export_shape, save_mesh
from octoplan.planner.bodies.forces import ExportWarning
from octoplan.planner.bodies.links import ros_messages, urdf
from octoplan.planner.bodies.mjcf import mjcf
from octoplan.planner.c_code.export import export, export_plan
from octoplan.planner.certificate import Certificate
from octoplan.planner.effect_ablation import Switch, switch_effects
from octoplan.planner.fit.calibrate import calibrate
from octoplan.planner.fit.calibration import Calibration
from octoplan.planner.fit.design import design
from octoplan.planner.fit.designed import Design
from octoplan.planner.fit.making import Making, Reach
from octoplan.planner.fit.measured import Measured
from octoplan.planner.fit.unknowns import Unknown
from octoplan.planner.io.csv_files import save_shape
from octoplan.planner.io.saved_files import load_calibration, load_plan
from octoplan.planner.many import FailedPlan, plan_many
from octoplan.planner.plan import Plan, plan
from octoplan.planner.program.problem import Problem
from octoplan.planner.question import Limits, Statement
from octoplan.planner.sweeps.sweep import sweep
from octoplan.planner.task import Trial
from octoplan.planner.trajectory.motion import trajectory
from octoplan.planner.trajectory.result import Trajectory

__all__ = [
    "Calibration",
    "Certificate",
    "Design",
    "ExportWarning",
    "FailedPlan",
    "Limits",
    "Making",
    "Measured",
    "Plan",
    "Problem",
    "Reach",
    "Statement",
    "Switch",
    "Trajectory",
    "Trial",
    "Unknown",
    "calibrate",
    "design",
    "export",
    "export_plan",
    "export_shape",
    "load_calibration",
    "load_plan",
    "mjcf",
    "plan",
    "plan_many",
    "ros_messages",
    "save_mesh",
    "save_shape",
    "stiffness",
    "sweep",
    "switch_effects",
    "trajectory",
    "urdf",
]
