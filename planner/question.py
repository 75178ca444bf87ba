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
from planner.program.limits import Limits
from planner.program.problem import is_explicit
from planner.program.statement import FORMS, Form, Statement
from planner.program.terms import compliance_requests
from planner.targets.base import Target


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


def with_form(
    statement: Statement, form: Form | None, scene: Scene, targets: tuple[Target, ...]
) -> Statement:
    """Return a statement of a form: unless given, of tensions alone where these give the poses."""
    condensed = statement.but(form="condensed")
    explicit = is_explicit(scene, condensed, compliance_requests(targets))
    return statement.but(form=form or ("condensed" if explicit else "multiple-shooting"))


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
