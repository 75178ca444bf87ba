"""Planning: targets, the nonlinear program, and plans that are checked."""

from model.stiffness import stiffness
from planner.certificate import Certificate
from planner.limits import Limits
from planner.plan import Plan, Start
from planner.problem import Problem, build
from planner.solve import plan
from planner.statement import Statement

__all__ = [
    "Certificate",
    "Limits",
    "Plan",
    "Problem",
    "Start",
    "Statement",
    "build",
    "plan",
    "stiffness",
]
