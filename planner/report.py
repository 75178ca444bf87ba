"""Results for people and for machines: a table, a dictionary of numbers, files written whole."""

from __future__ import annotations

import errno
import os
import tempfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model import Arm, Shape, Switch
from model.paths import Array
from planner.plan import Plan


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


def plan_text(plan: Plan) -> str:
    """Return a plan as it is shown to people."""
    table = tension_table(plan.arm, plan.tensions, np.array(plan.limits.upper))
    tip = "  ".join(f"{1e3 * x:.3f}" for x in plan.shape.tip)
    return "\n\n".join([plan.outcome, table, f"tip [mm]  {tip}", str(plan.certificate)])


def plan_dict(plan: Plan) -> dict[str, Any]:
    """Return a plan's results as plain values: SI units, angles in rad."""
    certificate = asdict(plan.certificate)
    return {
        "outcome": plan.outcome,
        "certified": plan.certificate.passed,
        "tensions_N": plan.tensions.tolist(),
        "tendons": [plan.arm.tendon_name(j) for j in range(plan.arm.n_tendons)],
        "effort_N": plan.effort,
        "tip_m": plan.shape.tip.tolist(),
        "tip_frame": plan.shape.tip_frame.tolist(),
        "certificate": certificate | {"passed": plan.certificate.passed},
        "starts": [asdict(start) for start in plan.starts],
        "mode": plan.mode,
        "versions": versions(),
    }


def shape_text(shape: Shape) -> str:
    """Return a settled shape as it is shown to people."""
    tip = "  ".join(f"{1e3 * x:.4f}" for x in shape.tip)
    frame = "\n".join("  " + " ".join(f"{x:9.5f}" for x in row) for row in shape.tip_frame)
    return (
        f"{tension_table(shape.arm, shape.tensions)}\n\ntip [mm]  {tip}\n\n"
        f"tip frame (columns t, n, b)\n{frame}\n\nestimated tip error [L]  {shape.error:.1e}"
    )


def shape_dict(shape: Shape) -> dict[str, Any]:
    """Return a settled shape as plain values: SI units."""
    s = np.linspace(0.0, shape.arm.length, 101)
    return {
        "tip_m": shape.tip.tolist(),
        "tip_frame": shape.tip_frame.tolist(),
        "tensions_N": shape.arm.by_section(shape.tensions).tolist(),
        "error": shape.error,
        "tendon_lengths_m": shape.tendon_lengths.tolist(),
        "s_m": s.tolist(),
        "position_m": shape.position(s).tolist(),
        "strain": shape.strain(s).tolist(),
        "versions": versions(),
    }


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


def switches_dict(switches: tuple[Switch, ...]) -> dict[str, Any]:
    """Return what each effect does and costs as plain values."""
    return {"effects": [asdict(switch) for switch in switches], "versions": versions()}


def versions() -> dict[str, str]:
    """Return the versions of what computes."""
    return {"octoplan": version("octoplan"), "casadi": version("casadi"), "numpy": version("numpy")}


def to_json(values: dict[str, Any]) -> bytes:
    """Return values as JSON, indented; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(values), indent=2)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, which is made if need be: all of them, or on an error none.

    They are staged in a folder inside it first, so that a full disk spoils nothing.
    """
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".new.") as staged:
            for name, content in contents.items():
                (Path(staged) / name).write_bytes(content)
            for name in contents:
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} in it is a folder")
            for name in contents:
                (Path(staged) / name).replace(folder / name)
    except BaseException:
        if new:
            folder.rmdir()
        raise
