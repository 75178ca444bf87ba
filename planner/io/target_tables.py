"""The targets of a scene file, one table each, told apart by their type."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta

import planner.targets
from model.errors import InputError
from planner.io.annotations import choice, quantity
from planner.io.arm_tables import VECTOR, Numbers, frame_form
from planner.io.codec import Form, table
from planner.io.obstacle_tables import public, tag_of
from planner.targets import Bend, Hold, MinimumStiffness, Softest, Stiffest, Target, TipPose


def _stiffness(direction: Numbers | None, matrix: Any) -> Any:
    if (direction is None) == (matrix is None):
        given = "neither" if matrix is None else "both"
        raise InputError("minimum-stiffness", given, "a direction, or a matrix")
    return matrix if direction is None else direction


def _stiffness_keys(own: Any) -> dict[str, Any]:
    return {"matrix" if np.ndim(own) == 2 else "direction": np.array(own).tolist()}


_MATRIX = "symmetric and positive definite, in place of a direction"
_AGAINST: dict[str, tuple[Any, Any]] = {
    "direction": (Annotated[VECTOR | None, Meta(description="in the base frame")], None),
    "matrix": (Annotated[tuple[VECTOR, VECTOR, VECTOR] | None, Meta(description=_MATRIX)], None),
}
_ON_OBJECT = quantity("on the object, base frame", "N")
_ABOUT = quantity("about its centre; taken up elsewhere without", "N m")
_WRENCH: dict[str, Any] = {
    "force": (Annotated[VECTOR, _ON_OBJECT],),
    "moment": (Annotated[VECTOR | None, _ABOUT], None),
}


def _wrench_keys(own: Numbers) -> dict[str, Any]:
    return {"force": list(own[:3])} | ({"moment": list(own[3:])} if own[3:] else {})


_FORMS: dict[Any, dict[str, Any]] = {
    TipPose: {"frame": frame_form("t wanted at the tip", "n wanted at the tip, across t")},
    MinimumStiffness: {"direction": Form(_AGAINST, _stiffness, _stiffness_keys)},
    Hold: {"wrench": Form(_WRENCH, lambda force, moment: (*force, *(moment or ())), _wrench_keys)},
}
# What a target is made of, or states itself with, is no target.
_PARTS = {Target, Bend, planner.targets.Terms, planner.targets.View}
_TABLES = {
    kind: table(kind, tag=tag_of(kind), **_FORMS.get(kind, {}))
    for kind in public(planner.targets)
    if kind not in _PARTS
}
TargetTable: Any = choice(list(_TABLES.values()))
ObjectiveTable: Any = choice([_TABLES[Stiffest], _TABLES[Softest]])
