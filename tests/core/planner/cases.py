"""Arms, targets read off settled shapes, and measures that several tests share, by NumPy alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Sampled, Scene, Shape, settle
from octoplan.model.effects import Extension
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    Target,
    TipPose,
    TipPosition,
)
from tests.oracles import Array

PAPER = Scene(Extension())


def changed(plan: Plan, **changes: Any) -> Plan:
    """Return a plan with other values of its problem and solution."""
    names = {field.name for field in fields(plan.problem)}
    asked = {name: value for name, value in changes.items() if name in names}
    found = {name: value for name, value in changes.items() if name not in names}
    problem, solution = replace(plan.problem, **asked), replace(plan.solution, **found)
    return replace(plan, problem=problem, solution=solution)


def figure_15() -> Array:
    """Tensions of the paper's fetch in space [N]."""
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0], T[2, 1] = 0.5, 4.0, 13.0
    return T


def moderate() -> Array:
    """Tensions that bend every section of table 4 a little, in different directions [N]."""
    T = np.zeros((3, 4))
    T[0, 1], T[1, 2], T[1, 3], T[2, 0] = 0.05, 0.8, 0.3, 1.5
    return T


def barrel_arm() -> Arm:
    """Five sections of three tendons at 120 degrees, staggered, on a sampled barrel."""
    s = np.linspace(0, 0.5, 9)
    radius = Sampled(tuple(s), tuple(0.009 + 0.005 * np.sin(np.pi * (0.15 + 0.85 * s / 0.5))))
    third = 2 * np.pi / 3
    sections = tuple(
        Anchorage(at, Linear(0.006, 0.004), tuple(stagger + third * j for j in range(3)))
        for at, stagger in zip(
            (0.49, 0.4, 0.31, 0.2, 0.1), np.radians([0, 24, 48, 72, 96]), strict=True
        )
    )
    return Arm(0.5, radius, sections)


def bend_and_plane(arm: Arm, shape: Shape) -> tuple[float, float]:
    """Angle between the tangents at base and tip, and plane in which the tip went [rad]."""
    t, n, b = np.array(arm.base_frame).T
    way = shape.tip - np.array(arm.base_position)
    plane = float(np.arctan2(-way @ n, way @ b))
    e = np.cos(plane) * b - np.sin(plane) * n
    tangent = shape.tip_frame[:, 0]
    return float(np.arctan2(tangent @ e, tangent @ t)), plane


def paper_tip(arm: Arm, T: Array) -> tuple[float, ...]:
    """Tip position of settled tensions [m]."""
    return tuple(settle(arm, T, PAPER, 1e-9).tip.tolist())


def read(kind: str, shape: Shape, section: int = 1) -> Target:
    """Return the target of a kind that a shape of three sections meets."""
    arm, tip = shape.arm, tuple(shape.tip.tolist())
    if kind == "tip":
        return TipPosition(tip)
    if kind == "pose":
        return TipPose(tip, tuple(map(tuple, shape.tip_frame.tolist())))
    if kind == "plane":
        bend, angle = bend_and_plane(arm, shape)
        return BendingPlane(angle, bend, section)
    if kind == "backbone":
        s = arm.length * np.arange(1, 7) / 6
        return Backbone(tuple(map(tuple, shape.position(s).tolist())), tuple(s.tolist()))
    ends = np.array([0.0, *arm.anchorages[::-1]])
    return Fetch(*(_bend(a, b) for a, b in pairwise(shape.frame(ends))))


def _bend(start: Array, end: Array) -> Bend:
    """Return the bend between two frames, and its plane from b towards -n of the first."""
    t, n, b = end[:, 0] @ start
    return Bend(float(np.arccos(np.clip(t, -1, 1))), float(np.arctan2(-n, b)))


def off(shape: Shape, target: Target, kind: str) -> float:
    """Return the distance of a shape from a target: the largest component, in m and rad."""
    found = read(kind, shape, getattr(target, "section", 1))
    apart = np.subtract([*_numbers(astuple(found))], [*_numbers(astuple(target))])
    if kind in ("plane", "fetch"):
        apart = np.arctan2(np.sin(apart), np.cos(apart))
    return float(np.abs(apart).max())


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for one in value:
            yield from _numbers(one)
    elif isinstance(value, int | float):
        yield float(value)
