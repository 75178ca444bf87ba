"""Planning: targets, the nonlinear program, and plans that are checked."""

import octoplan.planner.frontends.report  # noqa: F401  (it tells how results are shown)
from octoplan.model.stiffness import stiffness
from octoplan.planner.certificate import Certificate
from octoplan.planner.extensions.fit.calibrate import calibrate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.design import design
from octoplan.planner.extensions.fit.designed import Design
from octoplan.planner.extensions.fit.manufacturing import ManufacturingLimits, Reach
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.unknowns import Unknown
from octoplan.planner.extensions.trajectory.motion import trajectory
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.frontends.accuracy_study import AccuracyPoint, AccuracyStudy, accuracy_study
from octoplan.planner.frontends.arm_check import ArmCheck, Comparison, check_arm
from octoplan.planner.frontends.bodies.files import export_shape, save_mesh
from octoplan.planner.frontends.bodies.forces import ExportWarning
from octoplan.planner.frontends.bodies.links import ros_messages, urdf
from octoplan.planner.frontends.bodies.mjcf import mjcf
from octoplan.planner.frontends.c_code.export import export, export_plan
from octoplan.planner.frontends.effect_ablation import Switch, switch_effects
from octoplan.planner.frontends.io.csv_files import save_shape
from octoplan.planner.frontends.io.saved_files import load_calibration, load_plan
from octoplan.planner.frontends.many import FailedPlan, plan_many
from octoplan.planner.frontends.sweeps.sweep import sweep
from octoplan.planner.limits import Limits
from octoplan.planner.nlp_options import NlpOptions
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import Problem
from octoplan.planner.solution import Solution, Trial

__all__ = [
    "AccuracyPoint",
    "AccuracyStudy",
    "ArmCheck",
    "Calibration",
    "Certificate",
    "Comparison",
    "Design",
    "ExportWarning",
    "FailedPlan",
    "Limits",
    "ManufacturingLimits",
    "Measured",
    "NlpOptions",
    "Plan",
    "PlanningProblem",
    "Problem",
    "Reach",
    "Solution",
    "Switch",
    "Trajectory",
    "Trial",
    "Unknown",
    "accuracy_study",
    "calibrate",
    "check_arm",
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
