"""Scene files: TOML, checked key by key. The keys name their units where these are not SI."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from model import Arm, InputError, Scene
from model.effects import PrintedStatics, SelfContact
from model.errors import FileError
from model.loads import check_loads
from model.machine.compiled import Compile
from model.paths import Array
from model.units import warn_of_strokes
from model.winches import Winches, rest_lengths
from planner.avoidance.asked import surroundings
from planner.io.arm_tables import ArmTable, arm_of
from planner.io.codec import UNITS, si, table_of, written
from planner.io.effect_tables import EffectsTable, scene_of
from planner.io.files import read_file, why
from planner.io.key_paths import steps, value_at
from planner.io.mistakes import as_written, mistake, no_toml
from planner.io.obstacle_tables import inlined, obstacle_of
from planner.io.scene_tables import (
    LimitsTable,
    MotionTable,
    SceneTable,
    StiffnessTable,
    whole,
)
from planner.io.slips import check_modulus, warn_of_slips
from planner.io.target_tables import target_of
from planner.program.limits import Limits
from planner.question import check_targets
from planner.targets import Target

MM = UNITS["mm"]
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


def load(path: str | Path) -> Question:
    """Return the question of a scene file.

    Raises
    ------
    FileError
        With the file, the key's path, what is there and what is allowed.
    """
    return read(text_of(Path(path)), str(path))


def text_of(path: Path) -> bytes:
    """Return the text of a TOML file; FileError where it cannot be read or is of another kind."""
    try:
        text = read_file(path)
    except (OSError, ValueError) as reason:
        raise FileError(str(path), "", f"{why(reason)}; {_instead(path)}") from None
    if path.suffix.lower() != ".toml":
        raise FileError(
            str(path), "", "no scene file: those are TOML, with names that end in .toml"
        )
    return text


def read(text: bytes, name: str = "scene") -> Question:
    """Return the question of a scene file's text; see load."""
    return _given(decoded(text, name), name)


def _given(raw: dict[str, Any], name: str) -> Question:
    """Return the question of what somebody wrote: likely slips in it are told as UnitWarning."""
    question = question_of(raw, name)
    warn_of_slips(checked_table(raw, name))
    return question


def question_of(raw: dict[str, Any], name: str = "scene") -> Question:
    """Return the question of what a scene file holds, as TOML is decoded; see load."""
    table = checked_table(raw, name)
    check_modulus(table.arm.E_kPa, name)
    within = partial(_within, raw, name)
    arm = within("arm", arm_of, table.arm)
    scene = within("effects", scene_of, table.effects)
    # Contact of the arm with itself is refused by what does not state it: settle does.
    apart = Scene(*(effect for effect in scene.effects if not isinstance(effect, SelfContact)))
    within("effects", lambda _: check_loads(arm, apart, contact=True), None)
    winches = within(_winches_key(table), lambda own: _winches(arm, own), table)
    if table.tensions is not None and not winches:
        within("tensions", lambda given: arm.flat(given), table.tensions)
    targets = _targets(within, arm, table)
    options: dict[str, Any] = {"norm": str(table.norm), "solver": table.solver}
    options["stability_margin"] = table.stability_margin
    ways = _stated(within, arm, [(f"waypoints[{i}]", w) for i, w in enumerate(table.waypoints)])
    options |= _surroundings(within, arm, (*targets, *ways), table, Path(name).parent)
    if table.limits is not None:
        within("limits", lambda own: _check_limits(arm, own), table.limits)
        options |= _limits(table.limits)
    stiff = within("stiffness", lambda own: _stiffness(arm, own), table.stiffness)
    motion, held = _motion(table.motion), (table.tensions, winches)
    asked = (*held, table.accuracy, options, stiff, table.compile)
    return Question(arm, scene, targets, *asked, ways, motion, table.time_limit_s)


def _winches_key(table: SceneTable) -> str:
    return "lengths_mm" if table.strokes_mm is None else "strokes_mm"


def _surroundings(
    within: Callable[..., Any], arm: Arm, targets: tuple[Target, ...], table: SceneTable, at: Path
) -> dict[str, Any]:
    """Return what plan is told of obstacles, if there is something to keep clear of.

    Their files are looked for from a folder `at`.
    """

    def read(own: Any) -> Any:
        return obstacle_of(inlined(own, at))

    found = [within(f"obstacles[{i}]", read, own) for i, own in enumerate(table.obstacles)]
    asked = (found, table.clearance_mm * MM, table.self_clearance)
    key = "obstacles" if found else "clearance_mm"
    moves = bool(table.waypoints)
    if not within(
        key, lambda own: surroundings(arm, targets, own[0], own[1], own[2], moves), asked
    ):
        return {}
    return dict(zip(("obstacles", "clearance", "self_clearance"), asked, strict=True))


def _instead(path: Path) -> str:
    """Return what to name in place of a file that cannot be read."""
    others: dict[str, str] = {}
    with suppress(OSError, ValueError):
        found = (other for other in path.parent.glob("*.toml") if other.is_file())
        others = {other.stem: other.name for other in found}
    near = difflib.get_close_matches(path.stem, others, 1)
    if near:
        return f'did you mean "{path.with_name(others[near[0]])}"?'
    return "a scene file is wanted, `octoplan new FILE` writes one"


def decoded(text: bytes, name: str) -> dict[str, Any]:
    """Return what a TOML text holds; FileError with the line where it is none."""
    try:
        return dict(msgspec.toml.decode(text))
    except (msgspec.DecodeError, ValueError, RecursionError) as reason:
        raise no_toml(str(reason), text, name) from None


def converted(raw: dict[str, Any], kind: type[R], key: str, name: str, needed: str) -> R:
    """Return what a file holds as a table of a kind; FileError where a key is missing or wrong.

    `key` tells what file it is; `needed` is what is said where it is missing.
    """
    if key not in raw:
        raise FileError(name, key, f"missing; {needed}")
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, raw, kind) from None


def scene_beside(scene: str | dict[str, Any], path: Path) -> Question:
    """Return the question of a scene that a file at a path holds or names, from its folder."""
    if not isinstance(scene, str):
        return _given(scene, str(path))
    beside = path.parent / scene
    return _given(decoded(text_of(beside), str(beside)), str(beside))


def checked_table(raw: dict[str, Any], name: str) -> SceneTable:
    """Return the table of what a scene file holds, its keys checked one by one; FileError."""
    if "sweep" in raw:
        raise FileError(name, "sweep", f"this is a sweep file, for `octoplan sweep {name}`")
    if "arm" not in raw:
        told = 'missing; a scene needs an arm, such as [arm] preset = "table-4"'
        raise FileError(name, "arm", told)
    try:
        return msgspec.convert(raw, SceneTable)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, raw, SceneTable) from None


def _targets(within: Callable[..., Any], arm: Arm, table: SceneTable) -> tuple[Target, ...]:
    own = [] if table.target is None else [("target", table.target)]
    own += [(f"targets[{i}]", other) for i, other in enumerate(table.targets)]
    found = _stated(within, arm, own)
    if found:
        within("targets", lambda all_: check_targets(arm, all_), found)
    return found


def _stated(
    within: Callable[..., Any], arm: Arm, tables: list[tuple[str, Any]]
) -> tuple[Target, ...]:
    """Return the targets of tables with their keys, each checked."""
    found = []
    for key, other in tables:
        target = within(key, target_of, other)
        within(key, target.check, arm)
        found.append(target)
    return tuple(found)


def _motion(table: MotionTable) -> dict[str, Any]:
    """Return the rates and times of a motion in SI units."""
    return {
        "rate_max": table.rate_max,
        "stroke_rate_max": si(table.stroke_rate_max_mm_s, "mm/s"),
        "stroke_acceleration_max": si(table.stroke_acceleration_max_mm_s2, "mm/s2"),
        "tip_acceleration_max": table.tip_acceleration_max_m_s2,
        "times": table.times_s,
        **({"quasi_static": True} if table.quasi_static else {}),
    }


def _check_limits(arm: Arm, table: LimitsTable) -> None:
    limits = Limits.of(arm, table.tension_max, table.tension_min, table.total_pull)
    asked = _limits(table)
    limits.with_strokes(arm, asked.get("stroke_max"), asked.get("stroke_min"))


def _limits(table: LimitsTable) -> dict[str, Any]:
    """Return the limits as plan takes them, those of strokes [m] if there are any."""
    found = {
        key: getattr(table, key)
        for key in ("tension_max", "tension_min", "total_pull", "stroke_zero")
    }
    ends = {"stroke_max": table.stroke_max_mm, "stroke_min": table.stroke_min_mm}
    return found | {key: si(own, "mm") for key, own in ends.items() if own is not None}


def _stiffness(arm: Arm, table: StiffnessTable) -> dict[str, Any]:
    at: Any = "tip" if table.at_mm is None else table.at_mm * MM
    if at != "tip" and at > arm.length:
        raise InputError("at_mm", table.at_mm, f"up to the arm's length, {arm.length / MM:g} mm")
    if table.tendon_EA is not None and table.hold != "length":
        raise InputError("tendon_EA", table.tendon_EA, 'none, unless hold is "length"')
    chosen = {"hold": table.hold, "tendon_EA": table.tendon_EA, "release": table.release}
    return {"at": at, **chosen}


def _within(raw: dict[str, Any], name: str, key: str, build: Callable[[Any], R], table: Any) -> R:
    """Return what is built from a table; an error is told with the file and the table's key."""
    try:
        return build(table)
    except InputError as reason:
        raise as_written(reason, name, key, value_at(raw, steps(key))) from None


# Winches


def _winches(arm: Arm, table: SceneTable) -> dict[str, Any]:
    """Return the further arguments of settle: none where a file has tensions alone; InputError."""
    if table.lengths_mm is None and table.strokes_mm is None:
        for key, value in (
            ("tendon_EA", table.tendon_EA),
            ("tendon_outside_mm", table.tendon_outside_mm),
        ):
            if value:
                raise InputError(key, value, "none without lengths_mm or strokes_mm")
        return {}
    if table.lengths_mm is not None and table.strokes_mm is not None:
        raise InputError("strokes_mm", "given beside lengths_mm", "one of the two")
    if table.stiffness.tendon_EA is not None:
        own = table.stiffness.tendon_EA
        raise InputError("stiffness.tendon_EA", own, "tendon_EA at the top, beside lengths")
    lengths: Any = table.lengths_mm
    if table.strokes_mm is not None:
        lengths = _left(arm, table.strokes_mm)
    metres = si(lengths, "mm")
    found = {
        "lengths": metres,
        "tendon_EA": table.tendon_EA,
        "tendon_outside": si(table.tendon_outside_mm, "mm"),
    }
    Winches.of(arm, table.tensions, metres, table.tendon_EA, found["tendon_outside"])
    return found


def _left(arm: Arm, strokes: list[Any]) -> list[float]:
    """Return what is left of tendons by strokes (n_tendons,) [mm], nan where these are nan.

    Raises InputError for strokes of another form, and for more than there is of a tendon.
    """
    taken, rest = _flat(arm, strokes) * MM, rest_lengths(arm)
    for j in np.flatnonzero(np.isinf(taken) | (taken >= rest)):
        field, given = f"strokes[{j}] ({arm.tendon_name(int(j))})", f"{taken[j] / MM:g} mm"
        allowed = f"below {rest[j] / MM:.6g} mm, its length at rest, and negative where paid out"
        raise InputError(field, given, allowed)
    warn_of_strokes("strokes_mm", (taken / arm.length).tolist())
    return [*((rest - taken) / MM).tolist()]


def _flat(arm: Arm, strokes: list[Any]) -> Array:
    """Return strokes (n_tendons,) of their rows; the arm judges the form alone."""
    form = [[0.0 for _ in row] if isinstance(row, list) else 0.0 for row in strokes]
    arm.flat(form, "strokes")
    rows = [row if isinstance(row, list) else [row] for row in strokes]
    return np.array([value for row in rows for value in row], dtype=float)


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
    more = {key: own for key, own in keys.items() if own is not None}
    table: dict[str, Any] = {"arm": table_of(arm), "effects": table_of(scene or Scene())}
    table |= written(more)
    if tensions is not None:
        table["tensions"] = written(tensions)
    if target is not None:
        several = isinstance(target, tuple | list)
        found = [table_of(own) for own in (target if several else [target])]  # type: ignore[union-attr]
        table |= {"targets": found} if several else {"target": found[0]}
    if tension_max is not None:
        table["limits"] = {"tension_max": written(tension_max)} | table.get("limits", {})
    return table


def filled(raw: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what a scene file holds with all defaults, its meshes as numbers; FileError."""
    _given(raw, name)
    return whole(checked_table(raw, name), Path(name).parent)


def arm_and_scene(table: dict[str, Any]) -> tuple[Arm, Scene]:
    """Return arm and scene of a table that is whole; InputError where no such arm can be."""
    try:
        arm = arm_of(msgspec.convert(table["arm"], ArmTable))
        scene = scene_of(msgspec.convert(table["effects"], EffectsTable))
    except msgspec.ValidationError as reason:
        raise InputError("values", str(reason), "an arm that can be") from None
    check_loads(arm, scene)
    return arm, scene


def check_compute(asked: Question, compute: str) -> None:
    """Raise InputError, naming it, for what a scene has that a sweep does not take.

    Or lacks: a plan needs targets and limits, the others tensions or lengths.
    """
    if asked.scene.has(PrintedStatics):
        raise InputError("compute", f"{compute} as printed", "a scene without as_printed")
    if compute == "plan":
        if not asked.targets or "tension_max" not in asked.options:
            raise InputError("compute", "plan", "plan for a scene with [target] and [limits]")
    elif asked.tensions is None and not asked.winches:
        told = f"{compute} for a scene with tensions, lengths_mm or strokes_mm"
        raise InputError("compute", compute, told)
    if compute != "settle":
        check_loads(asked.arm, asked.scene, contact=True)
