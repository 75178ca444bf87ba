"""Results as people read them."""

from __future__ import annotations

import numpy as np

from model import Arm, OctoplanError, Shape, Switch
from model.effects import PrintedStatics
from model.paths import Array
from model.stiffness import Stiffness
from model.time_limit import OutOfTime
from planner.plan import Plan
from planner.tendon_lengths import length_error, strokes


def tension_table(arm: Arm, tensions: Array, upper: Array | None = None) -> str:
    """Return a table of tensions [N], a line a section."""
    flat = np.ravel(tensions)
    lines = ["tensions [N]"]
    for i in range(len(arm.sections)):
        own = arm.tendons_of(i + 1)
        cells = "".join(f"{arm.tendon_name(j):>7} {flat[j]:9.4f}" for j in own)
        lines.append(f"  section {i + 1} (at {1e3 * arm.sections[i].at:g} mm){cells}")
    if upper is not None and np.any(np.isfinite(upper)):
        at = np.flatnonzero(flat >= upper * (1 - 1e-9))
        held = [arm.tendon_name(int(j)) for j in at if upper[j]]
        lines.append(f"  at their maximum: {', '.join(held) or 'none'}")
    return "\n".join(lines)


def stroke_table(shape: Shape) -> str:
    """Return a table of what winches take in [mm], a line a section, and what their errors do."""
    taken, arm = 1e3 * strokes(shape), shape.arm
    lines = ["strokes [mm]"]
    for i in range(len(arm.sections)):
        own = arm.tendons_of(i + 1)
        cells = "".join(f"{arm.tendon_name(j):>7} {taken[j]:9.4f}" for j in own)
        lines.append(f"  section {i + 1} (at {1e3 * arm.sections[i].at:g} mm){cells}")
    slack = [arm.tendon_name(int(j)) for j in np.flatnonzero(shape.slack)]
    lines.append(f"  slack: {', '.join(slack) or 'none'}")
    if shape.undetermined:
        lines.append(f"  tensions not determined by lengths: {', '.join(shape.undetermined)}")
    found = length_error(shape)
    if found.names:
        cells = ", ".join(f"{n} {x:.3g}" for n, x in zip(found.names, found.each, strict=True))
        lines.append(f"  tip error by a wrong length [mm per mm]: {cells}; worst {found.worst}")
    return "\n".join(lines)


def plan_text(plan: Plan) -> str:
    """Return a plan as it is shown to people."""
    table = tension_table(plan.arm, plan.tensions, np.array(plan.limits.upper))
    parts = [plan.outcome, table, _strokes(plan), _tip(plan), str(plan.certificate)]
    return "\n\n".join(part for part in parts if part)


def _strokes(plan: Plan) -> str:
    if plan.scene.has(PrintedStatics):
        return ""
    try:
        return stroke_table(plan.shape)
    except (OctoplanError, OutOfTime):
        return ""


def _tip(plan: Plan) -> str:
    try:
        return "tip [mm]  " + "  ".join(f"{1e3 * x:.3f}" for x in plan.shape.tip)
    except (OctoplanError, OutOfTime):
        return ""


def shape_text(shape: Shape) -> str:
    """Return a settled shape as it is shown to people."""
    tip = "  ".join(f"{1e3 * x:.4f}" for x in shape.tip)
    frame = "\n".join("  " + " ".join(f"{x:9.5f}" for x in row) for row in shape.tip_frame)
    tables = [tension_table(shape.arm, shape.tensions)]
    if shape.winches is not None:
        tables.append(stroke_table(shape))
    return "\n\n".join(tables) + (
        f"\n\ntip [mm]  {tip}\n\n"
        f"tip frame (columns t, n, b)\n{frame}\n\nestimated tip error [L]  {shape.error:.1e}"
    )


def switch_table(switches: tuple[Switch, ...], accuracy: float) -> str:
    """Return what each effect does to a scene and what it costs, a line each."""
    head = (
        f"{'effect':<38}{'in scene':>9}{'tip change [L]':>15}{'states':>8}{'unknowns':>10}"
        f"{'instructions':>14}{'time':>8}  matters at {accuracy:.0e}"
    )
    lines = [head]
    for switch in switches:
        more = switch.sizes.instructions / switch.sizes_without.instructions
        cells = (
            f"{switch.effect:<38}{'yes' if switch.called_for else 'no':>9}"
            f"{_or_dash(switch.tip_change, '.1e'):>15}{switch.states_added:>+8}"
            f"{switch.sizes.unknowns - switch.sizes_without.unknowns:>+10}"
            f"{more:>13.2g}x{_or_dash(switch.time_factor, '.2g'):>7}x"
        )
        verdict = "yes" if switch.matters else "no"
        lines.append(f"{cells}  {verdict}{f': {switch.problem}' if switch.problem else ''}")
    return "\n".join(lines)


def _or_dash(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value, form)


def stiffness_text(k: Stiffness) -> str:
    """Return how a shape answers to forces, as it is shown to people."""
    held = "tensions held" if k.hold == "tension" else "lengths locked"
    place = "the tip" if k.at == k.shape.arm.length else f"s = {1e3 * k.at:g} mm"
    axes, directions = k.ellipsoid()
    lines = [f"how {place} gives way, {held} [mm/N]", f"{'':14}{'x':>11}{'y':>11}{'z':>11}"]
    for name, row in zip("xyz", k.compliance[:3, :3], strict=True):
        cells = "".join(f"{1e3 * value:11.4g}" for value in row)
        lines.append(f"  moves along {name}{cells[1:]}")
    lines.append("  (columns: the direction of the force)")
    soft = ["softest", "between", "stiffest"]
    ways = [
        f"  {name:<9}{1e3 * axis:11.4g} mm/N along {np.round(way, 3).tolist()}"
        for name, axis, way in zip(soft, axes, directions.T, strict=True)
    ]
    stable = "stable" if k.stable else "not stable"
    last = f"{stable} at held tensions; estimated relative error {k.error:.1e}"
    slack = (
        f"slack, could only pull: {', '.join(k.slack)}" if k.hold == "length" and k.slack else ""
    )
    parts = [tension_table(k.shape.arm, k.shape.tensions), "\n".join(lines), "\n".join(ways)]
    return "\n\n".join(part for part in [*parts, slack, last] if part)
