"""Scene files: TOML, checked key by key. The keys name their units where these are not SI."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from model import Arm, InputError, Scene
from model.effects import SelfContact
from model.errors import FileError
from model.loads import check_loads
from model.machine.compiled import Compile
from model.units import STROKE, length_text, warn_unusual
from model.winches import Winches, rest_lengths
from planner.avoidance.surroundings import surroundings
from planner.io.codec import arguments_of, in_si, table_of, value_of, written
from planner.io.files import read_toml, toml_of
from planner.io.key_paths import steps, value_at
from planner.io.mistakes import check_modulus, checked, made, warn_of_slips
from planner.io.object_tables import arm_of, inlined, scene_of
from planner.io.scene_tables import (
    LimitsTable,
    SceneTable,
    StiffnessTable,
    whole,
)
from planner.program.limits import Limits
from planner.question import check_targets
from planner.targets import Target

R = TypeVar("R")


@dataclass(frozen=True)
class Question:
    """What a scene file asks: an arm and a scene, and what to find or to settle.

    Attributes
    ----------
    arm, scene
    targets : tuple of Target
        What `plan` is to reach; none if the file has none.
    tensions : list or None
        [N], as settle takes them.
    winches : dict
        Further arguments of settle, if the file has lengths or strokes.
    accuracy : float
        Tip error over arm length.
    options : dict
        Further arguments of plan: norm, form, what to keep clear of and, if the file has limits,
        these.
    stiffness : dict
        Further arguments of stiffness.
    compile : bool or "auto"
        As settle, plan and stiffness take it.
    waypoints : tuple of Target
        What `trajectory` is to reach, in order.
    motion : dict
        Further arguments of trajectory: rates and times.
    time_limit : float or None
        After how long an answer has to be there [s].
    name : str
        Of the file.
    """

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    tensions: Any
    winches: dict[str, Any]
    accuracy: float
    options: dict[str, Any]
    stiffness: dict[str, Any]
    compile: Compile = False
    waypoints: tuple[Target, ...] = ()
    motion: dict[str, Any] = field(default_factory=dict)
    time_limit: float | None = None
    name: str = "scene"


def load(path: str | Path) -> Question:
    """Return the question of a scene file.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed.
    """
    return written_question(read_toml(Path(path))[0], str(path))


def read(text: bytes, name: str = "scene") -> Question:
    """Return the question of a scene file's text; see load."""
    return written_question(toml_of(text, name), name)


def written_question(raw: dict[str, Any], name: str) -> Question:
    """Return the question of what somebody wrote: likely slips in it are told as UnitWarning."""
    question = question_of(raw, name)
    warn_of_slips(raw)
    return question


def question_of(raw: dict[str, Any], name: str = "scene") -> Question:
    """Return the question of what a scene file holds, as TOML is decoded; see load."""
    table = checked_table(raw, name)
    check_modulus(table.arm.E_kPa, name)

    def build(key: str, make: Callable[[Any], R], of: Any = None) -> R:
        """Return what is made of a part of the table; an error is told at its key."""
        return made(name, key, make, of, part=value_at(raw, steps(key)) or {})

    def each(key: str, make: Callable[[Any], R]) -> tuple[R, ...]:
        """Return what is made of one table, or of several, under a key; none of none."""
        item = getattr(table, key)
        if not isinstance(item, tuple):
            return () if item is None else (build(key, make, item),)
        return tuple(build(f"{key}[{i}]", make, inside) for i, inside in enumerate(item))

    arm = build("arm", arm_of, table.arm)
    scene = build("effects", partial(_scene, arm), table.effects)
    winches = build(_winches_key(table), partial(_winches, arm), table)
    if table.tensions is not None and not winches:
        build("tensions", arm.flat, table.tensions)
    targets, ways = (
        sum((each(key, partial(_target, arm)) for key in keys), start=())
        for keys in (("target", "targets"), ("waypoints",))
    )
    if targets:
        build("targets", partial(check_targets, arm), targets)
    obstacles = list(each("obstacles", partial(_obstacle, Path(name).parent)))
    clear = in_si(table.clearance_mm, "mm"), table.self_clearance
    where, moves = "obstacles" if obstacles else "clearance_mm", bool(ways)
    around = build(
        where, lambda of: surroundings(arm, targets + ways, of, *clear, moves), obstacles
    )
    options = {key: getattr(table, key) for key in ("solver", "stability_margin")}
    options["norm"] = str(table.norm)
    if around:
        options |= {"obstacles": obstacles, "clearance": clear[0], "self_clearance": clear[1]}
    if table.limits is not None:
        options |= build("limits", partial(_limits, arm), table.limits)
    stiff = build("stiffness", partial(_stiffness, arm), table.stiffness)
    motion = arguments_of(table.motion)
    if not motion["quasi_static"]:
        del motion["quasi_static"]
    held = (table.tensions, winches, table.accuracy, options, stiff, table.compile)
    return Question(arm, scene, targets, *held, ways, motion, table.time_limit_s, name)


def _scene(arm: Arm, table: Any) -> Scene:
    """Return the scene of a table, checked on an arm.

    Contact of the arm with itself is refused by what does not state it: settle does.
    """
    scene = scene_of(table)
    apart = Scene(*(effect for effect in scene.effects if not isinstance(effect, SelfContact)))
    check_loads(arm, apart, contact=True)
    return scene


def _target(arm: Arm, table: Any) -> Target:
    target: Target = value_of(table)
    target.check(arm)
    return target


def _obstacle(folder: Path, table: Any) -> Any:
    """Return the obstacle of a table; its file is looked for from a folder."""
    return value_of(inlined(table, folder))


def _winches_key(table: SceneTable) -> str:
    return "lengths_mm" if table.strokes_mm is None else "strokes_mm"


@contextmanager
def scene_beside(
    scene: str | dict[str, Any], path: Path
) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield what a scene holds that a file at a path holds or names, its name, and its text.

    Mistakes inside the block are told where they are: under the key `scene` if it is in the file.
    """
    if isinstance(scene, str):
        beside = path.parent / scene
        raw, text = read_toml(beside)
        yield raw, str(beside), text
        return
    try:
        yield scene, str(path), ""
    except FileError as reason:
        raise FileError(reason.path, f"scene.{reason.where}", reason.problem) from None


def checked_table(raw: dict[str, Any], name: str) -> SceneTable:
    """Return the table of what a scene file holds, its keys checked one by one; FileError."""
    if "sweep" in raw:
        raise FileError(name, "sweep", f"this is a sweep file, for `octoplan sweep {name}`")
    needed = 'a scene needs an arm, such as [arm] preset = "table-4"'
    table: SceneTable = checked(raw, SceneTable, name, {"arm": needed})
    return table


def _limits(arm: Arm, table: LimitsTable) -> dict[str, Any]:
    """Return the limits as plan takes them, checked."""
    result = {key: item for key, item in arguments_of(table).items() if item is not None}
    limits = Limits.of(arm, result["tension_max"], result["tension_min"], result.get("total_pull"))
    limits.with_strokes(arm, result.get("stroke_max"), result.get("stroke_min"))
    return result


def _stiffness(arm: Arm, table: StiffnessTable) -> dict[str, Any]:
    result = arguments_of(table)
    if result["at"] is None:
        result["at"] = "tip"
    elif result["at"] > arm.length:
        allowed = f"up to the arm's length, {length_text(arm.length)}"
        raise InputError("at", result["at"], allowed)
    if table.tendon_EA is not None and table.hold != "length":
        raise InputError("tendon_EA", table.tendon_EA, 'none, unless hold is "length"')
    return result


# Winches


def _winches(arm: Arm, table: SceneTable) -> dict[str, Any]:
    """Return the further arguments of settle: none where a file has tensions alone; InputError."""
    if table.lengths_mm is None and table.strokes_mm is None:
        for key in ("tendon_EA", "tendon_outside_mm"):
            if getattr(table, key):
                raise InputError(key, getattr(table, key), "none without lengths_mm or strokes_mm")
        return {}
    if table.lengths_mm is not None and table.strokes_mm is not None:
        raise InputError("strokes_mm", "given beside lengths_mm", "one of the two")
    if table.stiffness.tendon_EA is not None:
        item = table.stiffness.tendon_EA
        raise InputError("stiffness.tendon_EA", item, "tendon_EA at the top, beside lengths")
    outside = in_si(table.tendon_outside_mm, "mm")
    lengths: Any = in_si(table.lengths_mm, "mm")
    if table.strokes_mm is not None:
        lengths = _left(arm, in_si(table.strokes_mm, "mm"))
    Winches.of(arm, table.tensions, lengths, table.tendon_EA, outside)
    return {"lengths": lengths, "tendon_EA": table.tendon_EA, "tendon_outside": outside}


def _left(arm: Arm, strokes: Any) -> list[float]:
    """Return what is left of tendons by strokes (n_tendons,) [m], nan where these are nan.

    Raises InputError for strokes of another form, and for more than there is of a tendon.
    """
    arm.flat([np.zeros(np.shape(row)).tolist() for row in strokes], "strokes")
    taken, rest = np.hstack([np.ravel(row) for row in strokes]), rest_lengths(arm)
    for j in np.flatnonzero(np.isinf(taken) | (taken >= rest)):
        field, stroke = f"strokes[{j}] ({arm.tendon_name(int(j))})", f"{1e3 * taken[j]:g} mm"
        allowed = f"below {1e3 * rest[j]:.6g} mm, its length at rest, and negative where paid out"
        raise InputError(field, stroke, allowed)
    warn_unusual("strokes_mm", (taken / arm.length).tolist(), STROKE)
    return [*(rest - taken).tolist()]


# Objects as files


def scene_table(
    arm: Arm,
    scene: Scene | None = None,
    target: Target | Iterable[Target] | None = None,
    *,
    tensions: Any = None,
    tension_max: Any = None,
    **keys: Any,
) -> dict[str, Any]:
    """Return the scene file that has this arm, scene and target, as TOML is decoded.

    Further keys are those of scene files; arrays, and objects of ours in them such as obstacles,
    are written. Raises InputError for what has no keys.
    """
    more = {key: item for key, item in keys.items() if item is not None}
    table: dict[str, Any] = {"arm": table_of(arm), "effects": table_of(scene or Scene())}
    table |= written(more)
    if tensions is not None:
        table["tensions"] = written(tensions)
    if target is not None:
        several = isinstance(target, tuple | list)
        result = [table_of(item) for item in (target if several else [target])]  # type: ignore[union-attr]
        table |= {"targets": result} if several else {"target": result[0]}
    if tension_max is not None:
        table["limits"] = {"tension_max": written(tension_max)} | table.get("limits", {})
    return table


def filled(raw: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what a scene file holds with all defaults, its meshes as numbers; FileError.

    Likely slips in it are told as UnitWarning.
    """
    warn_of_slips(raw)
    return whole(checked_table(raw, name), Path(name).parent)
