"""Checks of a planning question: statement, targets and limits."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import within
from model.effects import PrintedStatics
from model.errors import InputError
from model.scene import Scene
from model.units import warn
from planner.program.limits import Limits
from planner.program.statement import Statement, check_norm, check_solver
from planner.program.terms import compliance_requests, pulling_tendons
from planner.targets.base import Target

# The default stability margin of plans under loads.
MARGIN = 0.1
_FORMS = ("condensed", "multiple-shooting")


def checked_limits(
    arm: Arm,
    tension_max: Any,
    tension_min: Any,
    total_pull: float | None,
    strokes: tuple[Any, Any],
) -> Limits:
    """Return the limits from arguments of plan, of strokes as (stroke_max, stroke_min)."""
    return Limits.of(arm, tension_max, tension_min, total_pull).with_strokes(arm, *strokes)


def check_compliance_requests(targets: tuple[Target, ...], limits: Limits) -> None:
    """Raise InputError for a stiffness without limits."""
    if not compliance_requests(targets):
        return
    if not np.all(np.isfinite(limits.upper)) and limits.total is None:
        raise InputError("tension_max", np.inf, "finite limits where a stiffness is wanted")


def check_planned(scene: Scene) -> None:
    """Raise InputError for a scene that shapes are settled in, but none are planned."""
    if scene.has(PrintedStatics):
        allowed = (
            "a scene whose statics are consistent, such as Scene(Extension()); settle takes it"
        )
        raise InputError("scene", "written as printed", allowed)


def warn_of_form(form: Any) -> None:
    """Warn of a form, which has no meaning any more; refuse what never was one."""
    if form is None:
        return
    if form not in _FORMS:
        raise InputError("form", form, f"{', '.join(_FORMS)}; it is deprecated and has no effect")
    warning = "form has no effect: there is one program; solver= tells what solves it"
    warn(warning, DeprecationWarning)


def stated(limits: Limits, norm: Any, solver: Any, margin: Any) -> Statement:
    """Return the statement of a plan, checked; see plan."""
    limited, wound = limits.total is not None, limits.strokes is not None
    statement = Statement(check_solver(solver), check_norm(norm), limited=limited, wound=wound)
    return statement.but(margin=checked_margin(margin))


def checked_starts(starts: int | None) -> int | None:
    """Return the number of initial guesses; InputError for what is no such number."""
    if starts is not None and (type(starts) is not int or starts < 1):
        raise InputError("starts", starts, "a whole number from 1")
    return starts


def checked_margin(margin: Any) -> float:
    """Return a stability margin as a float, the default for None; InputError outside of [0, 1]."""
    return MARGIN if margin is None else within("stability_margin", margin, 0.0, 1.0)


def check_targets(arm: Arm, target: Target | Iterable[Target]) -> tuple[Target, ...]:
    """Return the targets as a tuple; InputError for what is none, misfits and contradictions."""
    targets = tuple(target) if isinstance(target, tuple | list) else (target,)
    if not targets:
        raise InputError("target", target, "at least one target")
    prescribed = dict[str, int]()
    for i, t in enumerate(targets):
        if not hasattr(t, "terms"):
            raise InputError("target", t, "a target such as TipPosition(...)")
        t.check(arm)
        for name in t.prescribed(arm):
            if name in prescribed:
                allowed = f"one target for it, not two: targets[{prescribed[name]}] prescribes it"
                raise InputError(f"targets[{i}]", f"another {name}", allowed)
            prescribed[name] = i
    if not pulling_tendons(arm, targets):
        raise InputError(
            "target", targets, "targets that leave some tendon to pull for all of them"
        )
    return targets
