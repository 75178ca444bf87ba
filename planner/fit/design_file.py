"""Design files: TOML; a scene with limits, tasks, and what of the arm is unknown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from model import InputError
from model.errors import FileError
from planner.fit.design import design
from planner.fit.designed import Design
from planner.fit.making import Making, Objective, Reach
from planner.scenefile import converted, decoded, scene_beside, text_of
from planner.scenes.keys import MM, NotNegative, Table
from planner.scenes.targets import SoftestTable, StiffestTable, TargetTable, target_of
from planner.targets import Softest, Stiffest
from planner.unknowns.tables import UnknownTable, unknown_of

_SUCH = """

scene = "scene.toml"
[[tasks]]
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]
[[unknowns]]
key = "arm.radius_mm[1]"
lower = 2.0
upper = 8.0"""


class MakingTable(Table, frozen=True):
    """See planner.Making."""

    wall_mm: Annotated[NotNegative, Meta(description="least, around a tendon [mm]")] = 0.0
    radius_mm: Annotated[NotNegative, Meta(description="least, of the body [mm]")] = 0.0
    spacing_mm: Annotated[NotNegative, Meta(description="least, of the anchorages [mm]")] = 0.0


class ReachTable(Table, tag="reach", frozen=True):
    """See planner.Reach."""

    direction: Annotated[tuple[float, float, float], Meta(description="in the base frame")]


class DesignFile(Table, frozen=True):
    """A design file: a scene, tasks, and what of the arm is unknown."""

    scene: Annotated[
        str | dict[str, Any], Meta(description="a scene file, from this file's folder; or a table")
    ]
    tasks: Annotated[tuple[TargetTable, ...], Meta(min_length=1, description="a target each")]
    unknowns: Annotated[tuple[UnknownTable, ...], Meta(min_length=1)]
    making: MakingTable = MakingTable()
    objective: Annotated[
        StiffestTable | SoftestTable | ReachTable | None,
        Meta(description="what is best while all tasks are met; the least effort unless given"),
    ] = None


def run_design(path: str | Path) -> Design:
    """Return the design that a file asks for; FileError with the file and the key."""
    path = Path(path)
    name = str(path)
    raw = decoded(text_of(path), name)
    file = converted(raw, DesignFile, "tasks", name, f"a design file is such as {_SUCH}")
    asked = scene_beside(file.scene, path)
    if asked.options.get("tension_min") or asked.options.get("total_pull"):
        told = "got tension_min or total_pull, allowed is tension_max alone in a design"
        raise FileError(name, "limits", told)
    unknowns = [unknown_of(own, name, f"unknowns[{i}]") for i, own in enumerate(file.unknowns)]
    making = Making(*(MM * getattr(file.making, f"{k}_mm") for k in ("wall", "radius", "spacing")))
    most = asked.options.get("tension_max", float("inf"))
    try:
        tasks = [target_of(own) for own in file.tasks]
        given = asked.arm, tasks, unknowns, asked.scene, most
        return design(*given, making=making, objective=_objective(file.objective))
    except FileError:
        raise
    except InputError as reason:
        raise FileError.of(reason, name, "") from None


def _objective(table: StiffestTable | SoftestTable | ReachTable | None) -> Objective:
    if table is None:
        return "effort"
    if isinstance(table, ReachTable):
        return Reach(table.direction)
    found = target_of(table)
    assert isinstance(found, Stiffest | Softest)
    return found
