"""Checks of a planning question: scene, limits and targets."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from model.arm import Arm
from model.effects import PrintedStatics
from model.errors import InputError
from model.scene import Scene
from model.settle import checked_scene, settle
from model.shape import Shape
from planner.program.limits import Limits
from planner.program.terms import pulling_tendons
from planner.targets.base import Target


def planned_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, that of the bare arm for None; InputError where no plans are made in it."""
    scene = checked_scene(arm, scene, contact=True)
    if scene.has(PrintedStatics):
        allowed = (
            "a scene whose statics are consistent, such as Scene(Extension()); settle takes it"
        )
        raise InputError("scene", "written as printed", allowed)
    return scene


def checked_limits(
    arm: Arm,
    scene: Scene,
    tension_max: Any = np.inf,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    stroke_max: Any = None,
    stroke_min: Any = None,
    stroke_zero: Any = "straight",
    **_: Any,
) -> Limits:
    """Return the limits from arguments of plan, of which others may be there too.

    Raises InputError, and as settle does where winches are zeroed "at rest".
    """
    limits = Limits.of(arm, tension_max, tension_min, total_pull)
    limits = limits.with_strokes(arm, stroke_max, stroke_min)
    return replace(limits, stroke_zero=_zeroed_at(arm, scene, stroke_zero))


def _zeroed_at(arm: Arm, scene: Scene, zero: Any) -> tuple[float, ...] | None:
    """Return the tendons' lengths where winches are zeroed [m]; None at the straight arm at rest.

    See plan. Raises InputError for what is not allowed, and as settle does where the arm does not
    stand in the scene without tensions.
    """
    if isinstance(zero, str) and zero == "straight":
        return None
    if isinstance(zero, str) and zero == "at rest":
        zero = settle(arm, np.zeros(arm.n_tendons), scene)
    lengths: Any = zero.tendon_lengths if isinstance(zero, Shape) and zero.arm == arm else zero
    if isinstance(lengths, str | Shape) or not isinstance(lengths, Iterable):
        allowed = '"straight", "at rest", a shape of this arm, or the lengths of its tendons [m]'
        given = "of another arm" if isinstance(zero, Shape) else zero
        raise InputError("stroke_zero", given, allowed)
    flat = arm.flat(lengths, "stroke_zero")
    if flat.min() <= 0:
        raise InputError("stroke_zero", zero, "lengths above 0 [m]")
    return tuple(flat.tolist())


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
