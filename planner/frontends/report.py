"""Text, tables and figures of results, for terminals and notebooks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from importlib import import_module
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.compliance import length_error
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.stiffness import Stiffness
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime
from octoplan.model.support.text import Part, columns, parts_of, shape_text, shown_by, tendon_table
from octoplan.model.tendons import strokes
from octoplan.planner.certificate import Certificate
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.designed import Design
from octoplan.planner.extensions.trajectory.certificate import MotionCertificate
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.frontends.accuracy_study import AccuracyPoint, AccuracyStudy, duration
from octoplan.planner.frontends.arm_check import ArmCheck
from octoplan.planner.frontends.effect_ablation import Switch
from octoplan.planner.frontends.io.records import stability_under_loads
from octoplan.planner.frontends.many import FailedPlan
from octoplan.planner.plan_result import Plan

# Text and tables

# Maximal number of rows of a table.
_SCREEN = 40


def _plan(plan: Plan) -> Iterator[Part]:
    """Yield outcome, tendons and tip of a plan, then the certificate."""
    arm = plan.arm
    T = np.ravel(plan.tensions)
    upper = np.array(plan.problem.limits.upper)
    table = tendon_table("tensions [N]", arm.tendons_by_section, T)
    if np.any(np.isfinite(upper)):
        at = np.flatnonzero((upper > 0) & np.isclose(T, upper, 1e-9, 0.0))
        held = [arm.tendon_name(int(j)) for j in at]
        table += f"\n  at their maximum: {', '.join(held) or 'none'}"
    tables = [plan.outcome, table]
    # A plan without equilibrium has no shape.
    with suppress(OctoplanError, OutOfTime):
        tables += _winches(plan.shape, plan.problem.limits.stroke_zero)
        tables.append("tip [mm]  " + "  ".join(f"{1e3 * x:.3f}" for x in plan.shape.tip))
    yield "\n\n".join(tables)
    yield ""
    yield from parts_of(plan.certificate)


def _winches(shape: Shape, zero: Any = None) -> list[str]:
    """Return tables of tendon lengths and strokes [mm], and the sensitivity to length errors.

    `zero` (n_tendons,) are the lengths at the zero of the winches [m], see strokes.
    """
    arm = shape.arm
    error = length_error(shape)
    lengths = tendon_table(
        "tendon lengths [mm]", arm.tendons_by_section, 1e3 * shape.tendon_lengths
    )
    title = f"strokes [mm] from {'the straight arm at rest' if zero is None else 'the given zero'}"
    lines = [tendon_table(title, arm.tendons_by_section, 1e3 * strokes(shape, zero))]
    slack = ", ".join(arm.tendon_name(int(j)) for j in np.flatnonzero(shape.slack))
    lines.append(f"  slack: {f'{slack}; their strokes are upper bounds' if slack else 'none'}")
    if shape.undetermined:
        lines.append(f"  tensions not determined by lengths: {', '.join(shape.undetermined)}")
    if error:
        cells = ", ".join(f"{name} {x:.3g}" for name, x in error.items())
        worst = max(error, key=lambda name: error[name])
        lines.append(f"  tip error per length error [mm/mm]: {cells}; largest for {worst}")
    return [lengths, "\n".join(lines)]


def _shape(shape: Shape) -> Iterator[Part]:
    """Yield the text of a shape, with strokes if lengths were given, and the stability."""
    if shape.winches is None:
        yield repr(shape)
    else:
        table = tendon_table("tensions [N]", shape.arm.tendons_by_section, shape.tensions)
        tables = [table, *_winches(shape)]
        yield shape_text(tables, shape.tip, shape.tip_frame, shape.error, shape.remarks)
    value = stability_under_loads(shape)
    if value is not None:
        state = "stable" if value > 0 else "not stable"
        yield f"\nstability under the loads [-]  {value:.3g}: {state}; 1 at rest, 0 at buckling"


def _certificate(result: Certificate | MotionCertificate) -> Iterator[Part]:
    by = f" (checked by {result.scheme})" if isinstance(result, Certificate) else ""
    yield f"certificate: {'PASSED' if result.passed else 'FAILED'}{by}"
    yield result.rows
    if isinstance(result, Certificate):
        if result.passed and not result.optimal:
            yield f"  {result.optimality}"
        yield from (f"  beware: {warning}" for warning in result.warnings)
    yield from (f"  failed: {failure}" for failure in result.failures)


def _scene(scene: Scene) -> Iterator[Part]:
    rows = [["effect", "settings"]]
    for effect in scene.effects:
        shown = (f.name for f in fields(effect) if f.repr)
        values = ", ".join(f"{name} = {getattr(effect, name)!r}" for name in shown)
        rows.append([type(effect).__name__, values])
    yield rows if scene.effects else [*rows, ["none: the arm bends only", ""]]


def _trajectory(motion: Trajectory) -> Iterator[Part]:
    yield motion.outcome
    count = motion.times.size
    if count <= _SCREEN:
        yield "\ntensions [N]"
        shown = np.arange(count)
    else:
        yield f"\ntensions [N] at targets; all {count} times are in `times`, `save` and --out"
        shown = np.array([0, *motion.stops])
    pairs = zip(motion.times[shown], motion.flat[shown], strict=True)
    rows = ([f"{t:.4g}", *(f"{x:.4f}" for x in T)] for t, T in pairs)
    yield [["t [s]", *motion.arm.tendon_names], *rows]
    yield ""
    yield from parts_of(motion.certificate)


def _calibration(fit: Calibration) -> Iterator[Part]:
    yield fit.outcome
    rows = zip(fit.unknowns, fit.values, fit.std, strict=True)
    cells = ([x.name, f"{v:.6g}", f"{std:.2g}", fit.parameters.unit(x)] for x, v, std in rows)
    yield [["unknown", "value", "std", "unit"], *cells]


def _design(result: Design) -> Iterator[Part]:
    yield result.outcome
    parameters = result.parameters
    values = zip(result.unknowns, result.values, strict=True)
    pairs = zip(values, parameters.start, strict=True)
    cells = ([x.name, f"{v:.5g}", f"{old:.5g}", parameters.unit(x)] for (x, v), old in pairs)
    yield [["unknown", "designed", "given", "unit"], *cells]
    plans = enumerate(zip(result.plans, result.before, strict=True), 1)
    efforts = ([f"{i}", f"{now.effort:.4g}", f"{old.effort:.4g}"] for i, (now, old) in plans)
    yield [["task", "effort [N]", "given arm [N]"], *efforts]


def _accuracy(study: AccuracyStudy) -> Iterator[Part]:
    """Yield the recommendation, then times and errors of each accuracy."""
    yield study.recommendation
    curves = {"settle": study.settling, "plan": study.planning}
    curves = {name: curve for name, curve in curves.items() if curve}
    rows = [["accuracy", *(f"{name} {what}" for name in curves for what in ("time", "error"))]]
    for points in zip(*curves.values(), strict=True):
        cells = [cell for point in points for cell in _accuracy_cells(point)]
        rows.append([f"{points[0].accuracy:.0e}", *cells])
    yield rows
    yield (
        "Errors of settle: distance of the tip from the reference over the length. Errors of plan: "
        f"largest residual of the targets. Reference: {study.reference_scheme}, to "
        f"{study.reference:.0e}."
    )
    yield from study.problems


def _accuracy_cells(point: AccuracyPoint) -> list[str]:
    """Return time and error of an accuracy."""
    return ["-", "failed"] if point.problem else [duration(point.seconds), f"{point.error:.1e}"]


def _check(result: ArmCheck) -> Iterator[Part]:
    """Yield the outcome, the comparisons, and the reasons for refusals."""
    yield result.outcome
    rows = [["comparison", "sets", "refused", "largest disagreement [L]", "allowed", "beyond"]]
    for each in result.comparisons:
        counts = str(len(each.disagreements)), str(len(each.refusals))
        sizes = f"{each.largest:.1e}", f"{each.allowed:.0e}"
        rows.append([each.name, *counts, *sizes, str(each.n_beyond)])
    yield rows
    for count, text in result.reasons():
        yield f"{count} x for example: {text}"


def switch_table(switches: tuple[Switch, ...], length: float, tolerance: float) -> str:
    """Return a table of the effects: tip movement, run time and verdict, one line each, and notes.

    `length` is the arm's [m].
    """
    head = ["effect", "in scene", "tip moves by [mm]", "share of L", "time factor", "verdict"]
    rows = [head]
    notes = [
        f"Keep or add: the effect moves the tip by more than {100 * tolerance:g} % of the length, "
        f"{1e3 * tolerance * length:.3g} mm (--tolerance {tolerance:g}), or an effect to keep or "
        "add requires the effect, or the arm does not settle otherwise.",
        "Drop or leave out: the effect moves the tip by less. Effects that require an effect are "
        "switched too.",
        "Time factor: time of settle with the effect over the time without.",
    ]
    for switch in switches:
        moved = f"{1e3 * length * switch.tip_change:.3g}"
        share = percent(switch.tip_change)
        factor = f"{switch.time_factor:.2g}"
        if switch.problem:
            moved = share = factor = "-"
            notes.append(f"{switch.effect}: {switch.problem}")
        present = "yes" if switch.enabled else "no"
        rows.append([switch.effect, present, moved, share, factor, verdict(switch)])
    return "\n".join([*columns(rows), "", *notes])


def verdict(switch: Switch) -> str:
    """Return the advice for an effect: keep or drop it, add it or leave it out."""
    if switch.enabled:
        return "keep" if switch.matters else "drop"
    return "add" if switch.matters else "leave out"


def percent(share: float) -> str:
    """Return a fraction as text in percent; fractions below 0.001 % are one text."""
    return f"{100 * share:.2g} %" if share == 0 or share >= 1e-5 else "< 0.001 %"


# Figures: matplotlib is imported with the first


def figure(module: str, name: str) -> Callable[..., Any]:
    """Return a function of octoplan.planner.frontends.plots that is imported when called."""
    name_of_module = f"octoplan.planner.frontends.plots.{module}"
    return lambda *arguments: getattr(import_module(name_of_module), name)(*arguments)


_SHAPE = figure("plan", "plot_shape")


shown_by(Arm, lambda arm, *ax: _SHAPE(settle(arm, np.zeros(arm.n_tendons), accuracy=1e-2), *ax))
shown_by(Shape, _SHAPE, _shape)
shown_by(Stiffness, lambda k, ax=None: figure("ellipsoids", "plot_ellipsoids")([k], None, ax))
shown_by(Scene, None, _scene)
shown_by(Certificate, None, _certificate)
shown_by(MotionCertificate, None, _certificate)
shown_by(Trajectory, lambda motion, *_: figure("motion", "plot_trajectory")(motion), _trajectory)
shown_by(Calibration, None, _calibration)
shown_by(Design, None, _design)
shown_by(ArmCheck, figure("results", "plot_check"), _check)
shown_by(AccuracyStudy, figure("results", "plot_accuracy"), _accuracy)
shown_by(Plan, figure("plan", "plot_plan"), _plan)
shown_by(FailedPlan, None, _plan)
