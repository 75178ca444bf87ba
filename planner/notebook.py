"""How values are drawn, and what notebooks show of them: results with figures, others as tables."""

from __future__ import annotations

import math
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np

from model.arm import Arm
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.stiffness import Stiffness
from model.text import html_table, preformatted, shown_by
from planner.certificate import Certificate
from planner.fit.calibration import Calibration
from planner.fit.designed import Design
from planner.many import FailedPlan
from planner.plan import Plan
from planner.trajectory.certificate import MotionCertificate
from planner.trajectory.result import Trajectory

# Rows of a motion's table; digits of its tensions.
_MOST = 25


def force_to_show(k: Stiffness) -> float:
    """Return a power of ten [N]: the force that moves the point by no more than L / 5."""
    most = 0.2 * k.shape.arm.length / float(k.ellipsoid()[0][0])
    return float(10.0 ** math.floor(math.log10(most)))


def _arm(arm: Arm, ax: Any = None) -> Any:
    return _shape(settle(arm, np.zeros(arm.n_tendons), accuracy=1e-2), ax)


def _shape(shape: Shape, ax: Any = None) -> Any:
    from planner.plots.plan import plot_shape

    return plot_shape(shape, ax)


def _plan(plan: Plan, ax: Any = None) -> Any:
    from planner.plots.plan import plot_plan

    return plot_plan(plan, ax)


def _stiffness(k: Stiffness, ax: Any = None) -> Any:
    from planner.plots.results import plot_ellipsoids

    return plot_ellipsoids([k], force_to_show(k), ax)


def _trajectory(motion: Trajectory, ax: Any = None) -> Any:
    from planner.plots.motion import plot_trajectory

    return plot_trajectory(motion)


def _scene_table(scene: Scene) -> str:
    rows = [["effect", "settings"]]
    for effect in scene.effects:
        own = ", ".join(f"{f.name} = {getattr(effect, f.name)!r}" for f in fields(effect))
        rows.append([type(effect).__name__, own])
    return html_table(rows if scene.effects else [*rows, ["none: the bare arm", ""]])


def _certificate_table(found: Certificate) -> str:
    return _verdict(found, html_table([["checked", "value", "allowed"], *found.rows]))


def _motion_table(found: MotionCertificate) -> str:
    return _verdict(found, html_table([["checked", "value"], *found.rows]))


def _verdict(found: Any, table: str) -> str:
    lines = [f"<b>{'PASSED' if found.passed else 'FAILED'}</b>", table]
    lines += [f"failed: {escape(own)}<br/>" for own in found.failures]
    return "".join(lines + [f"beware: {escape(own)}<br/>" for own in _warnings(found)])


def _warnings(found: Any) -> tuple[str, ...]:
    return found.warnings if isinstance(found, Certificate) else ()


def _plan_table(found: Plan) -> str:
    return f"{preformatted(repr(found))}{_certificate_table(found.certificate)}"


def _trajectory_table(found: Trajectory) -> str:
    names = [found.arm.tendon_name(j) for j in range(found.arm.n_tendons)]
    rows = [["t [s]", *(f"{name} [N]" for name in names)]]
    step = -(-len(found.times) // _MOST)
    for t, T in zip(found.times[::step], found.flat[::step], strict=True):
        rows.append([f"{t:.4g}", *(f"{own:.3g}" for own in T)])
    table = html_table(rows, f"every {step}th time" if step > 1 else "")
    return f"<p>{escape(found.outcome)}</p>{table}{_motion_table(found.certificate)}"


def _calibration_table(found: Calibration) -> str:
    rows = [["unknown", "value", "std", "unit"]]
    for own, value, std in zip(found.unknowns, found.values, found.std, strict=True):
        rows.append([own.name, f"{value:.6g}", f"{std:.2g}", found.parameters.unit(own)])
    return f"<p>{escape(found.outcome)}</p>{html_table(rows)}"


def _design_table(found: Design) -> str:
    rows = [["unknown", "designed", "given", "unit"]]
    for own, value, old in zip(found.unknowns, found.values, found.parameters.start, strict=True):
        rows.append([own.name, f"{value:.5g}", f"{old:.5g}", found.parameters.unit(own)])
    tasks = [["task", "effort [N]", "of the given arm [N]"]]
    for i, (now, before) in enumerate(zip(found.plans, found.before, strict=True)):
        tasks.append([str(i + 1), f"{now.effort:.4g}", f"{before.effort:.4g}"])
    return f"<p>{escape(found.outcome)}</p>{html_table(rows)}{html_table(tasks)}"


shown_by(Arm, _arm)
shown_by(Shape, _shape)
shown_by(Stiffness, _stiffness)
shown_by(Scene, table=_scene_table)
shown_by(Certificate, table=_certificate_table)
shown_by(MotionCertificate, table=_motion_table)
shown_by(Trajectory, _trajectory, _trajectory_table)
shown_by(Calibration, table=_calibration_table)
shown_by(Design, table=_design_table)
shown_by(Plan, _plan, _plan_table)
shown_by(FailedPlan, table=lambda found: preformatted(repr(found)))
