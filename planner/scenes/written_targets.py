"""Targets as the tables of scene files: what planner.scenes.targets reads, the other way round."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from model import InputError
from planner.scenes.keys import mm, rounded
from planner.scenes.obstacles import obstacle_table
from planner.targets import (
    Backbone,
    BendingPlane,
    Fetch,
    FetchReach,
    Hold,
    MinimumStiffness,
    Softest,
    Stiffest,
    TipPointing,
    TipPose,
    TipPosition,
    Wrap,
)


@singledispatch
def target_table(target: Any) -> dict[str, Any]:
    """Return the [target] table that asks for a target; InputError for a kind without keys."""
    raise InputError("target", target, "one of planner.targets: others have no keys")


@target_table.register
def _(target: TipPosition) -> dict[str, Any]:
    return {"type": "tip-position", "position_mm": mm(target.position)}


@target_table.register
def _(target: TipPointing) -> dict[str, Any]:
    own = {"position_mm": mm(target.position), "weights": list(target.weights)}
    return {"type": "tip-pointing", "direction": list(target.direction), **own}


@target_table.register
def _(target: TipPose) -> dict[str, Any]:
    frame = np.array(target.frame)
    own = {"position_mm": mm(target.position), "weights": list(target.weights)}
    columns = {"tangent": frame[:, 0].tolist(), "normal": frame[:, 1].tolist()}
    return {"type": "tip-pose", **columns, **own}


@target_table.register
def _(target: BendingPlane) -> dict[str, Any]:
    angles = {"angle_deg": _deg(target.angle), "bend_deg": _deg(target.bend)}
    return {"type": "bending-plane", **angles, "section": int(target.section)}


@target_table.register
def _(target: Backbone) -> dict[str, Any]:
    table: dict[str, Any] = {"type": "backbone", "points_mm": [mm(p) for p in target.points]}
    if target.s is not None:
        table["s_mm"] = mm(target.s)
    if target.weights is not None:
        table["weights"] = list(target.weights)
    return table


@target_table.register
def _(target: Fetch) -> dict[str, Any]:
    bends = {name: getattr(target, name) for name in ("proximal", "medial", "distal")}
    return {"type": "fetch"} | {
        f"{name}_deg": [_deg(bend.angle), _deg(bend.plane)] for name, bend in bends.items()
    }


@target_table.register
def _(target: FetchReach) -> dict[str, Any]:
    table = {"type": "fetch-reach", "mouth_mm": mm(target.mouth), "bend_deg": _deg(target.bend)}
    return table if target.plane is None else table | {"plane_deg": _deg(target.plane)}


@target_table.register
def _(target: MinimumStiffness) -> dict[str, Any]:
    given = np.array(target.direction)
    key = "matrix" if given.ndim == 2 else "direction"
    own = {"type": "minimum-stiffness", "value": target.value, key: given.tolist()}
    return own | _held(target)


@target_table.register
def _(target: Stiffest | Softest) -> dict[str, Any]:
    kind = "stiffest" if isinstance(target, Stiffest) else "softest"
    return {"type": kind, "direction": list(target.direction)} | _held(target)


@target_table.register
def _(target: Wrap) -> dict[str, Any]:
    given = {"turns": target.turns, "tolerance": target.tolerance}
    for key, own in (("length_mm", target.length), ("start_mm", target.start)):
        given[key] = None if own is None else mm([own])[0]
    kept = {key: own for key, own in given.items() if own is not None}
    return {"type": "wrap", "obstacle": obstacle_table(target.obstacle), **kept}


@target_table.register
def _(target: Hold) -> dict[str, Any]:
    parts = {"force": list(target.wrench[:3]), "moment": list(target.wrench[3:])}
    kept = {key: own for key, own in parts.items() if own}
    obstacle = obstacle_table(target.obstacle)
    return {"type": "hold", "obstacle": obstacle, **kept, "friction": target.friction}


def _held(target: Any) -> dict[str, Any]:
    held = {"hold": target.hold}
    return held if target.tendon_EA is None else held | {"tendon_EA": target.tendon_EA}


def _deg(radians: float) -> float:
    return rounded(float(np.degrees(radians)))
