"""What may be asked of a plan: form, targets and limits, checked together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import within
from model.effects import PrintedStatics
from model.errors import InputError
from model.paths import Array
from model.scene import Scene
from planner.program.effort import check_norm
from planner.program.limits import Limits
from planner.program.problem import is_explicit
from planner.program.statement import FORMS, Form, Statement
from planner.program.terms import compliance_requests
from planner.targets.base import Target


def checked_limits(
    arm: Arm,
    scene: Scene,
    tension_max: Any,
    tension_min: Any,
    total_pull: float | None,
    strokes: tuple[Any, Any],
) -> Limits:
    """Return the limits that are given, of strokes as (stroke_max, stroke_min); see plan."""
    limits = Limits.of(arm, tension_max, tension_min, total_pull).with_strokes(arm, *strokes)
    check_strokes(scene, limits)
    return limits


def check_compliance_requests(targets: tuple[Target, ...], scene: Scene, limits: Limits) -> None:
    """Raise InputError for a stiffness where nothing is known of loads, and without limits."""
    if not compliance_requests(targets):
        return
    if scene.has(PrintedStatics):
        raise InputError("target", "a stiffness", "shapes alone, in a scene as printed")
    if not np.all(np.isfinite(limits.upper)) and limits.total is None:
        raise InputError("tension_max", np.inf, "finite limits where a stiffness is wanted")


def check_strokes(scene: Scene, limits: Limits) -> None:
    """Raise InputError for limits of strokes where tendons have no lengths."""
    if limits.strokes is not None and scene.has(PrintedStatics):
        raise InputError("stroke_max", "given as printed", "none, in a scene as printed")


def checked_form(form: Form | None) -> Form | None:
    """Return the form as it is; refuse what is none."""
    if form is not None and form not in FORMS:
        raise InputError("form", form, ", ".join(FORMS))
    return form


def stated(
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    norm: Any,
    form: Form | None,
    margin: Any,
) -> Statement:
    """Return the statement of a plan, checked; see plan.

    Unless a form is given it is that of tensions alone where these give the poses.
    """
    limited, wound = limits.total is not None, limits.strokes is not None
    own = Statement("condensed", check_norm(norm), limited=limited, wound=wound)
    own = own.but(margin=checked_margin(margin))
    explicit = is_explicit(scene, own, compliance_requests(targets))
    return own.but(form=checked_form(form) or ("condensed" if explicit else "multiple-shooting"))


def checked_starts(starts: int | None) -> int | None:
    """Return how many initial guesses are asked for; InputError for what is no such number."""
    if starts is not None and (type(starts) is not int or starts < 1):
        raise InputError("starts", starts, "a whole number from 1")
    return starts


def checked_margin(margin: Any) -> float:
    """Return a stability margin as a float; InputError outside of [0, 1]."""
    return within("stability_margin", margin, 0.0, 1.0)


def check_targets(arm: Arm, target: Target | Iterable[Target]) -> tuple[Target, ...]:
    """Return the targets as a tuple; InputError for what is none, misfits and contradictions."""
    targets = tuple(target) if isinstance(target, tuple | list) else (target,)
    if not targets:
        raise InputError("target", target, "at least one target")
    prescribed: dict[str, Array] = {}
    for t in targets:
        if not hasattr(t, "terms"):
            raise InputError("target", t, "a target such as TipPosition(...)")
        t.check(arm)
        for name, value in t.prescribed(arm).items():
            if name in prescribed:
                allowed = f"one target for it, not two: another has {prescribed[name].tolist()}"
                raise InputError(f"target: {name}", value.tolist(), allowed)
            prescribed[name] = value
    if not frozenset.intersection(*(t.tendons(arm) for t in targets)):
        raise InputError(
            "target", targets, "targets that leave some tendon to pull for all of them"
        )
    return targets
