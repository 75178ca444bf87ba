"""Planning: targets, the nonlinear program, and plans that are checked."""

from octoplan_packages import check_own

check_own("model")  # before what would fail without naming the file

import planner.report  # noqa: F401  (it tells how results are shown)
from model.stiffness import stiffness
from planner.bodies.files import export_shape, save_mesh
from planner.bodies.forces import ExportWarning
from planner.bodies.links import ros_messages, urdf
from planner.bodies.mjcf import mjcf
from planner.c_code.export import export, export_plan
from planner.certificate import Certificate
from planner.effect_ablation import Switch, switch_effects
from planner.fit.calibrate import calibrate
from planner.fit.calibration import Calibration
from planner.fit.design import design
from planner.fit.designed import Design
from planner.fit.making import Making, Reach
from planner.fit.measured import Measured
from planner.fit.unknowns import Unknown
from planner.io.csv_files import save_shape
from planner.io.saved_files import load_calibration, load_plan
from planner.many import FailedPlan, plan_many
from planner.plan import Plan, plan
from planner.program.problem import Problem
from planner.question import Limits, Statement
from planner.sweeps.sweep import sweep
from planner.task import Trial
from planner.trajectory.motion import trajectory
from planner.trajectory.result import Trajectory

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
