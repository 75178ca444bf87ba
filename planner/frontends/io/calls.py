"""Call settle, stiffness, plan and trajectory with the contents of a scene file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from octoplan.model import Shape, settle
from octoplan.model.stiffness import Stiffness, stiffness
from octoplan.model.support.errors import FileError, InputError
from octoplan.planner.extensions.trajectory.motion import trajectory
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.frontends.io.codec import names_of
from octoplan.planner.frontends.io.mistakes import error_context
from octoplan.planner.frontends.io.scene_file import SceneFile
from octoplan.planner.frontends.io.scene_tables import MotionTable
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan

R = TypeVar("R")
_EXAMPLES = {
    "target": 'a [target] table, such as [target] type = "tip-position", '
    "position_mm = [250, 0, -150]",
    "limits": "a [limits] table, such as [limits] tension_max = 20.0 (N, each tendon)",
    "waypoints": '[[waypoints]] tables, such as type = "tip-position", '
    "position_mm = [250, 0, -150]",
    "motion.rate_max": "a rate of tensions (N/s), or another limit of rates or times_s in [motion]",
}
# Keys in files of arguments of trajectory, in the units of the arguments.
_MOTION = {"times": "motion.times_s", "rate_max": "motion.rate_max"}


def check_complete(question: SceneFile, *keys: str) -> None:
    """Raise FileError for the first of some keys that a scene file lacks."""
    has = {
        "target": question.targets,
        "limits": "limits" in question.options,
        "waypoints": question.waypoints,
        "motion.rate_max": any(question.options.get(name) for name in names_of(MotionTable)),
        "tensions": question.tensions is not None,
    }
    for key in keys:
        if not has[key]:
            example = _EXAMPLES.get(key) or _tensions_example(question)
            raise FileError(question.name, key, f"missing: must be {example}")


def _tensions_example(question: SceneFile) -> str:
    rows = (f"[{', '.join(['0.0'] * len(item.angles))}]" for item in question.arm.sections)
    place = "at the top of the file, above the first [table]"
    return f"tensions = [{', '.join(rows)}] (N) {place}"


def check_drive(question: SceneFile) -> None:
    """Raise FileError if a scene file has neither tensions nor lengths."""
    if "lengths" not in question.options:
        check_complete(question, "tensions")


def _computed(question: SceneFile, function: Callable[..., R], argument: Any, **more: Any) -> R:
    """Return the result of a function for a scene file, given tensions or targets."""
    with error_context(question.name, ""), _keys_of_motion():
        return function(question.arm, argument, question.scene, **question.of(function) | more)


@contextmanager
def _keys_of_motion() -> Iterator[None]:
    """Name the key in the file if an argument of trajectory is wrong."""
    try:
        yield
    except InputError as reason:
        name = re.match(r"\w*", reason.field)[0]  # type: ignore[index]
        if isinstance(reason, FileError) or name not in _MOTION:
            raise
        field = reason.field.replace(name, _MOTION[name], 1)
        raise InputError(field, reason.given, reason.allowed) from None


def run_settle(question: SceneFile) -> Shape:
    """Return the shape for the tensions or lengths of a scene file; FileError without both."""
    check_drive(question)
    return _computed(question, settle, question.tensions)


def run_stiffness(question: SceneFile) -> Stiffness:
    """Return the stiffness for a scene file; FileError without tensions and lengths."""
    check_drive(question)
    return _computed(question, stiffness, question.tensions, **question.stiffness)


def run_plan(question: SceneFile) -> Plan:
    """Return the plan for a scene file; FileError without target or limits."""
    check_complete(question, "target", "limits")
    return _computed(question, plan, question.targets)


def run_trajectory(question: SceneFile) -> Trajectory:
    """Return the trajectory for a scene file; FileError without waypoints, motion or limits."""
    check_complete(question, "waypoints", "motion.rate_max", "limits")
    return _computed(question, trajectory, list(question.waypoints))
