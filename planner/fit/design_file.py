"""Design files: TOML; a scene with limits, tasks, and what of the arm is unknown."""

from __future__ import annotations

from pathlib import Path

from model import InputError
from model.errors import FileError
from planner.fit.design import design
from planner.fit.designed import Design
from planner.fit.making import Making, Objective, Reach
from planner.fit.unknowns import unknown_of
from planner.io.codec import si
from planner.io.scene_file import converted, decoded, scene_beside, text_of
from planner.io.scene_tables import DesignFile, ReachTable
from planner.io.target_tables import SoftestTable, StiffestTable, target_of
from planner.targets import Softest, Stiffest

_SUCH = """

scene = "scene.toml"
[[tasks]]
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]
[[unknowns]]
key = "arm.radius_mm[1]"
lower = 2.0
upper = 8.0"""


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
    least = (file.making.wall_mm, file.making.radius_mm, file.making.spacing_mm)
    making = Making(*si(least, "mm"))
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
