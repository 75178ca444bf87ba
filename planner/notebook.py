"""How values are drawn, and what notebooks show of them: results with figures, others as tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from html import escape
from importlib import import_module
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
from planner.fit.design import Design
from planner.many import FailedPlan
from planner.plan import Plan
from planner.trajectory.certificate import MotionCertificate
from planner.trajectory.result import Trajectory

# Rows of a motion's table; tensions that are 0 there, over the largest.
_MOST, _NOTHING = 25, 1e-6


def force_to_show(k: Stiffness) -> float:
    """Return a power of ten [N]: the force that moves the point by no more than L / 5."""
    most = 0.2 * k.shape.arm.length / float(k.ellipsoid()[0][0])
    return float(10.0 ** math.floor(math.log10(most)))


def _figure(module: str, name: str) -> Callable[..., Any]:
    """Return what draws a value, in axes if given: matplotlib is loaded with the first figure."""
    return lambda *of: getattr(import_module(f"planner.plots.{module}"), name)(*of)


def _stiffness(k: Stiffness, ax: Any = None) -> Any:
    return import_module("planner.plots.results").plot_ellipsoids([k], force_to_show(k), ax)


def _motion(motion: Trajectory, _: Any = None) -> Any:
    return import_module("planner.plots.motion").plot_trajectory(motion)


def _at_rest(arm: Arm, ax: Any = None) -> Any:
    return _SHAPE(settle(arm, np.zeros(arm.n_tendons), accuracy=1e-2), ax)


def _scene_table(scene: Scene) -> str:
    rows = [["effect", "settings"]]
    for effect in scene.effects:
        values = ", ".join(f"{f.name} = {getattr(effect, f.name)!r}" for f in fields(effect))
        rows.append([type(effect).__name__, values])
    return html_table(rows if scene.effects else [*rows, ["none: the bare arm", ""]])


def _certificate_table(certificate: Certificate) -> str:
    return _verdict(certificate, html_table([["checked", "value", "allowed"], *certificate.rows]))


def _motion_table(certificate: MotionCertificate) -> str:
    return _verdict(certificate, html_table([["checked", "value"], *certificate.rows]))


def _verdict(result: Any, table: str) -> str:
    lines = [f"<b>{'PASSED' if result.passed else 'FAILED'}</b>", table]
    lines += [f"failed: {escape(failure)}<br/>" for failure in result.failures]
    return "".join(lines + [f"beware: {escape(each)}<br/>" for each in _warnings(result)])


def _warnings(result: Any) -> tuple[str, ...]:
    return result.warnings if isinstance(result, Certificate) else ()


def _plan_table(result: Plan) -> str:
    return f"{preformatted(repr(result))}{_certificate_table(result.certificate)}"


def _trajectory_table(motion: Trajectory) -> str:
    names = motion.arm.tendon_names
    rows = [["t [s]", *(f"{name} [N]" for name in names)]]
    step = -(-len(motion.times) // _MOST)
    shown = np.where(motion.flat > _NOTHING * motion.flat.max(), motion.flat, 0.0)
    for t, T in zip(motion.times[::step], shown[::step], strict=True):
        rows.append([f"{t:.4g}", *(f"{each:.3g}" for each in T)])
    table = html_table(rows, f"every {step}th time" if step > 1 else "")
    return f"<p>{escape(motion.outcome)}</p>{table}{_motion_table(motion.certificate)}"


def _calibration_table(fit: Calibration) -> str:
    rows = [["unknown", "value", "std", "unit"]]
    for unknown, value, std in zip(fit.unknowns, fit.values, fit.std, strict=True):
        rows.append([unknown.name, f"{value:.6g}", f"{std:.2g}", fit.parameters.unit(unknown)])
    return f"<p>{escape(fit.outcome)}</p>{html_table(rows)}"


def _design_table(result: Design) -> str:
    rows = [["unknown", "designed", "given", "unit"]]
    for unknown, value, old in zip(
        result.unknowns, result.values, result.parameters.start, strict=True
    ):
        rows.append([unknown.name, f"{value:.5g}", f"{old:.5g}", result.parameters.unit(unknown)])
    tasks = [["task", "effort [N]", "of the given arm [N]"]]
    for i, (now, before) in enumerate(zip(result.plans, result.before, strict=True)):
        tasks.append([str(i + 1), f"{now.effort:.4g}", f"{before.effort:.4g}"])
    return f"<p>{escape(result.outcome)}</p>{html_table(rows)}{html_table(tasks)}"


_SHAPE = _figure("plan", "plot_shape")
shown_by(Arm, _at_rest)
shown_by(Shape, _SHAPE)
shown_by(Stiffness, _stiffness)
shown_by(Scene, table=_scene_table)
shown_by(Certificate, table=_certificate_table)
shown_by(MotionCertificate, table=_motion_table)
shown_by(Trajectory, _motion, _trajectory_table)
shown_by(Calibration, table=_calibration_table)
shown_by(Design, table=_design_table)
shown_by(Plan, _figure("plan", "plot_plan"), _plan_table)
shown_by(FailedPlan, table=lambda result: preformatted(repr(result)))
