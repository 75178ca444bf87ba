"""Export of the inverse map as C: tensions that follow a moving tip target."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError
from octoplan.planner.frontends.c_code.source import Precision, numbers
from octoplan.planner.limits import Limits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.program_instance import tension_scales
from octoplan.planner.targets import TipPosition

# Tolerances: miss over the arm length; slope of the effort over the largest tension; softness of
# the target in a step; rounding.
_SETTINGS: dict[Precision, tuple[float, ...]] = {
    "double": (1e-9, 1e-8, 1e-6, 1e-12),
    "float": (1e-5, 2e-4, 1e-5, 1e-5),
}
# Deviations of targets and tensions in the test, in addition to the error of the mesh.
_ROUNDED: dict[Precision, tuple[float, float]] = {"double": (1e-8, 1e-6), "float": (1e-5, 5e-3)}
# Displacement of the targets of the test, over the arm length.
_MOVED = 0.02
# Deviation of tensions over the maximum, per deviation of meshes over the arm length.
_LEVER = 100.0
_MOVES = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 1), (0, -1, -1), (0, 0, 0))
# Upper bound of tension limits in units, representable in single precision.
_NO_LIMIT = 1e9


def check_inverse(p: Plan) -> None:
    """Raise InputError for a plan whose inverse cannot be exported."""
    exported = "the inverse is exported for one TipPosition and least squares of the tensions"
    is_tip = len(p.targets) == 1 and type(p.targets[0]) is TipPosition
    checks: list[tuple[bool, str, object, str]] = [
        (not is_tip, "target", p.targets, "one TipPosition"),
        (p.problem.limits.total is not None, "total_pull", p.problem.limits.total, "omitted"),
        (p.problem.options.norm != "2", "norm", p.problem.options.norm, "2"),
        (bool(p.problem.environment), "obstacles", p.problem.environment, "omitted"),
        (p.base is not None, "base", p.base, "None, a fixed base"),
    ]
    for wrong, field, value, allowed in checks:
        if wrong:
            raise InputError(field, value, f"{allowed}; {exported}")
    if p.mode != "exact" or not p.reached:
        raise InputError("target", p.targets[0], f"a reachable target; {p.outcome}")


def inverse_values(p: Plan, shape: Shape, precision: Precision) -> dict[str, str]:
    """Return the texts for the placeholders in the files of the inverse."""
    arm = p.arm
    n = arm.n_tendons
    unit = tension_scales(arm, p.problem.limits)
    upper = np.minimum(p.problem.limits.upper, _NO_LIMIT * unit)
    met, level, soft, rounding = _SETTINGS[precision]
    targets, tensions = _followed(p)
    off, apart = _ROUNDED[precision]
    values = {
        "SCALE": unit.max(),
        "ARM_LENGTH": arm.length,
        "MET": met,
        "LEVEL": level,
        "SOFT": soft,
        "ROUNDING": rounding,
        "TENSION_MIN": p.problem.limits.lower,
        "TENSION_MAX": upper,
        "FIRST_TARGET": p.targets[0].parameters(arm),
        "FIRST_TENSION": p.tensions,
        "UNIT": unit,
        "TEST_TARGET": targets,
        "TEST_FOUND": tensions,
        "TEST_MET": off,
        "TEST_ALIKE": apart + _LEVER * max(shape.error, p.problem.accuracy),
    }
    static = 14 + 11 * n + 2 * n * n + 4 * n
    return {
        **{place: numbers(value, precision) for place, value in values.items()},
        "TEST_TARGETS": str(len(targets)),
        "PLAN_NUMBERS": str(static),
        "SQRT": "sqrt" if precision == "double" else "sqrtf",
    }


def _followed(p: Plan) -> tuple[Array, Array]:
    """Return targets (K, 3) [m] near the target of a plan, and the tensions (K, n_tendons) [N].

    Each plan is warm-started from the one before.
    """
    start = p.targets[0].parameters(p.arm)
    results: list[Array] = []
    targets: list[Array] = []
    options: dict[str, Any] = {
        "limits": Limits(tension_min=p.problem.limits.lower),
        "accuracy": p.problem.accuracy,
        "certify": False,
    }
    upper = p.problem.limits.upper
    near = p
    for move in _MOVES:
        place = start + _MOVED * p.arm.length * np.array(move)
        target = TipPosition(tuple(place.tolist()))
        moved = plan(p.arm, target, p.scene, upper, near=near, **options)
        if moved.mode != "exact" or moved.solution.jump:
            continue
        near = moved
        targets.append(place)
        results.append(np.ravel(moved.tensions))
    return np.array(targets).reshape(-1, 3), np.array(results)
