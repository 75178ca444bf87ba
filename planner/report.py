"""Results as people read them."""

from __future__ import annotations

from typing import Any

import numpy as np

from model import Arm, OctoplanError, Shape
from model.paths import Array
from model.text import columns, shape_text, tendon_table
from model.time_limit import OutOfTime
from planner.answer import Answer
from planner.effect_ablation import Switch
from planner.tendon_lengths import length_error, strokes


def tension_table(arm: Arm, tensions: Array, upper: Array) -> str:
    """Return a table of tensions [N], a line a section, and which are at their maximum."""
    flat = np.ravel(tensions)
    lines = [tendon_table("tensions [N]", arm.tendons_by_section, flat)]
    if np.any(np.isfinite(upper)):
        at = np.flatnonzero(flat >= upper * (1 - 1e-9))
        held = [arm.tendon_name(int(j)) for j in at if upper[j]]
        lines.append(f"  at their maximum: {', '.join(held) or 'none'}")
    return "\n".join(lines)


def length_table(shape: Shape) -> str:
    """Return a table of the tendons' lengths [mm], a line a section."""
    tendon = shape.arm.tendons_by_section
    return tendon_table("tendon lengths [mm]", tendon, 1e3 * shape.tendon_lengths)


def stroke_table(shape: Shape, zero: Any = None) -> str:
    """Return a table of what winches take in [mm], a line a section, and what their errors do.

    `zero` (n_tendons,) are the tendons' lengths where winches are zeroed [m], see strokes.
    """
    arm = shape.arm
    title = f"strokes [mm] from the {'straight arm at rest' if zero is None else 'zero given'}"
    lines = [tendon_table(title, arm.tendons_by_section, 1e3 * strokes(shape, zero))]
    slack = [arm.tendon_name(int(j)) for j in np.flatnonzero(shape.slack)]
    slack_text = f"{', '.join(slack)}; their strokes are at most those above" if slack else "none"
    lines.append(f"  slack: {slack_text}")
    if shape.undetermined:
        lines.append(f"  tensions not determined by lengths: {', '.join(shape.undetermined)}")
    error = length_error(shape)
    if error.names:
        cells = ", ".join(f"{n} {x:.3g}" for n, x in zip(error.names, error.each, strict=True))
        lines.append(f"  tip error by a wrong length [mm per mm]: {cells}; worst {error.worst}")
    return "\n".join(lines)


def plan_text(plan: Answer) -> str:
    """Return a plan as it is shown to people, with all that was checked."""
    return f"{plan!r}\n\n{plan.certificate}"


def plan_summary(plan: Answer) -> str:
    """Return the outcome of a plan, its tendons and its tip: what fits a screen."""
    table = tension_table(plan.arm, plan.tensions, np.array(plan.limits.upper))
    return "\n\n".join([plan.outcome, table, *_of_shape(plan)])


def _of_shape(plan: Answer) -> list[str]:
    """Return lengths, strokes and tip; nothing where the tensions do not settle."""
    try:
        shape = plan.shape
        tables = [length_table(shape), stroke_table(shape, plan.limits.stroke_zero)]
    except (OctoplanError, OutOfTime):
        return []
    return [*tables, "tip [mm]  " + "  ".join(f"{1e3 * x:.3f}" for x in shape.tip)]


def settled_text(shape: Shape) -> str:
    """Return a settled shape as it is shown to people; by lengths, with what winches take in."""
    if shape.winches is None:
        return repr(shape)
    table = tendon_table("tensions [N]", shape.arm.tendons_by_section, shape.tensions)
    tables = [table, length_table(shape), stroke_table(shape)]
    return shape_text(tables, shape.tip, shape.tip_frame, shape.error, shape.remarks)


def switch_table(switches: tuple[Switch, ...], accuracy: float) -> str:
    """Return what each effect does to a scene and what it costs, a line each, and notes."""
    head = ["effect", "in scene", "tip change [L]", "states", "unknowns", "instructions", "time"]
    rows = [[*head, f"matters at {accuracy:.0e}"], *map(_switch_row, switches)]
    notes = ["States, unknowns, instructions and time: of the scene with the effect, over without."]
    fewer = [switch.effect for switch in switches if switch.unknowns_added < 0]
    if fewer:
        names = ", ".join(fewer)
        notes.append(f"Fewer unknowns with {names}: a coarser mesh is as accurate there.")
    notes += [f"{switch.effect}: {switch.problem}" for switch in switches if switch.problem]
    return "\n".join([*columns(rows), "", *notes])


def _switch_row(switch: Switch) -> list[str]:
    more = switch.sizes.instructions / switch.sizes_without.instructions
    return [
        switch.effect,
        "yes" if switch.enabled else "no",
        _or_dash(switch.tip_change, ".1e"),
        f"{switch.states_added:+}",
        f"{switch.unknowns_added:+}",
        f"x {more:.2g}",
        _or_dash(switch.time_factor, ".2g", "x "),
        "yes" if switch.matters else "no",
    ]


def _or_dash(value: float, form: str, before: str = "") -> str:
    return "-" if np.isnan(value) else f"{before}{value:{form}}"
