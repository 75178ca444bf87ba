"""Load scene files: TOML, checked key by key; keys have units other than SI."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from octoplan.model import Arm, InputError, Scene
from octoplan.model.extensions.lengths.winches import Winches
from octoplan.model.loads import check_arm
from octoplan.model.support.errors import Described, FileError
from octoplan.model.support.units import STROKE, length_text, warn_unusual
from octoplan.model.tendons import rest_lengths
from octoplan.planner.extensions.avoidance.surroundings import surroundings
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.frontends.io.codec import (
    arguments,
    arguments_of,
    encode,
    in_si,
    table_of,
    value_of,
)
from octoplan.planner.frontends.io.files import parse_toml, path_of, read_toml
from octoplan.planner.frontends.io.key_paths import steps, value_at
from octoplan.planner.frontends.io.mistakes import build_at, check_modulus, checked, warn_of_slips
from octoplan.planner.frontends.io.object_tables import arm_of, inline_mesh
from octoplan.planner.frontends.io.scene_tables import (
    LimitsTable,
    OptionsTable,
    SceneTable,
    StiffnessTable,
    scene_of,
    with_defaults,
)
from octoplan.planner.limits import Limits, checked_limits
from octoplan.planner.planning_problem import check_targets
from octoplan.planner.targets import Target
from octoplan.planner.targets.base import as_targets

R = TypeVar("R")


@dataclass(frozen=True)
class SceneFile:
    """The contents of a scene file as arguments of settle, stiffness, plan and trajectory.

    Attributes
    ----------
    arm, scene
    targets : tuple of Target
        Targets of `plan`; empty if the file has none.
    waypoints : tuple of Target
        Targets of `trajectory`, in order.
    tensions : list or None
        Argument of settle [N].
    options : dict
        Keyword arguments of settle, stiffness, plan and trajectory.
    stiffness : dict
        Further keyword arguments of stiffness.
    name : str
        Name of the file.
    """

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    waypoints: tuple[Target, ...]
    tensions: Any
    options: dict[str, Any]
    stiffness: dict[str, Any]
    name: str = "scene"

    def of(self, function: Callable[..., Any]) -> dict[str, Any]:
        """Return the options that are arguments of a function."""
        return {key: self.options[key] for key in arguments(function) if key in self.options}

    @property
    def accuracy(self) -> float:
        """Tip error over arm length."""
        return float(self.options["accuracy"])

    @property
    def time_limit(self) -> float | None:
        """Limit of the computing time [s]; None without limit."""
        return self.options.get("time_limit")

    def but(self, **options: Any) -> SceneFile:
        """Return a copy with other options."""
        return replace(self, options=self.options | options)


def load(path: str | Path) -> SceneFile:
    """Return the contents of a scene file.

    Raises
    ------
    FileError
        With the file, the key path, the entry and the allowed values.
    """
    return load_decoded(read_toml(path_of(path))[0], str(path))


def read(text: bytes, name: str = "scene") -> SceneFile:
    """Return the contents of the text of a scene file; see load."""
    return load_decoded(parse_toml(text, name), name)


def load_decoded(raw: dict[str, Any], name: str) -> SceneFile:
    """Return the contents of a decoded scene file; issue a UnitWarning for each likely slip."""
    question = question_of(raw, name)
    warn_of_slips(raw)
    return question


def question_of(raw: dict[str, Any], name: str = "scene") -> SceneFile:
    """Return the contents of a decoded scene file; see load."""
    table = checked_table(raw, name)
    check_modulus(table.arm.E_kPa, name)

    def build(key: str, make: Callable[[Any], R], value: Any = None) -> R:
        """Return `make(value)`; report errors at a key of the file."""
        return build_at(name, key, make, value, part=value_at(raw, steps(key)) or {})

    def build_each(key: str, make: Callable[[Any], R]) -> tuple[R, ...]:
        """Return the values built from the tables under a key; empty if the key is missing."""
        item = getattr(table, key)
        if not isinstance(item, tuple):
            return () if item is None else (build(key, make, item),)
        return tuple(build(f"{key}[{i}]", make, inside) for i, inside in enumerate(item))

    arm = build("arm", arm_of, table.arm)
    scene = build("effects", partial(_scene, arm), table.effects)
    by = "lengths_mm" if table.strokes_mm is None else "strokes_mm"
    winches = build(by, partial(_winches, arm), table)
    if table.tensions is not None and not winches:
        build("tensions", arm.flat, table.tensions)
    targets = build_each("target", partial(_target, arm))
    targets += build_each("targets", partial(_target, arm))
    waypoints = build_each("waypoints", partial(_target, arm))
    if targets:
        build("targets", partial(check_targets, arm), targets)
    options = _without_none(arguments_of(table, OptionsTable)) | winches
    folder = Path(name).parent
    obstacles = list(build_each("obstacles", lambda item: value_of(inline_mesh(item, folder))))

    def check_surroundings(given: list[Any]) -> None:
        surroundings(
            arm,
            targets + waypoints,
            given,
            clearance=options["clearance"],
            of_itself=options["self_clearance"],
            in_time=bool(waypoints),
        )

    build("obstacles" if obstacles else "clearance_mm", check_surroundings, obstacles)
    options |= {"obstacles": obstacles} | _without_none(arguments_of(table.motion))
    if table.limits is not None:
        options |= build("limits", partial(_limits, arm), table.limits)
    if table.base is not None:
        options["base"] = build("base", partial(_base, arm), table.base)
    stiff = build("stiffness", partial(_stiffness, arm), table.stiffness)
    return SceneFile(arm, scene, targets, waypoints, table.tensions, options, stiff, name)


def _without_none(arguments: dict[str, Any]) -> dict[str, Any]:
    return {key: item for key, item in arguments.items() if item is not None}


def _scene(arm: Arm, table: Any) -> Scene:
    """Return the scene of a table, checked with an arm.

    The functions that use the scene raise InputError for effects that they do not support.
    """
    scene = scene_of(table)
    check_arm(arm, scene)
    return scene


def _target(arm: Arm, table: Any) -> Target:
    target: Target = value_of(table)
    target.check(arm)
    return target


@contextmanager
def scene_beside(
    scene: str | dict[str, Any], path: Path
) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield the contents, the name and the text of the scene that another file has or names.

    `path` is the other file. If the scene is in this file, errors of the block are reported under
    the key `scene`.
    """
    if isinstance(scene, str):
        beside = path.parent / scene
        raw, text = read_toml(beside)
        yield raw, str(beside), text
        return
    try:
        yield scene, str(path), ""
    except FileError as reason:
        where = f"scene.{reason.where}"
        raise FileError(reason.path, where, reason.problem, reason.entry) from None


def checked_table(raw: dict[str, Any], name: str) -> SceneTable:
    """Return the contents of a scene file as a table; raise FileError with the first wrong key."""
    if "sweep" in raw:
        raise FileError(name, "sweep", f"must be omitted; run `octoplan sweep {name}` for sweeps")
    return checked(raw, SceneTable, name, "arm", "plan")


def _limits(arm: Arm, table: LimitsTable) -> dict[str, Any]:
    """Return the limits as arguments of plan, checked."""
    given = arguments_of(table)
    zero = given.pop("stroke_zero")
    limits = Limits(**given)
    checked_limits(arm, Scene(), limits=limits)
    return {"limits": limits, "stroke_zero": zero}


def _base(arm: Arm, table: Any) -> BaseJoints:
    joints: BaseJoints = value_of(table)
    joints.check(arm)
    return joints


def _stiffness(arm: Arm, table: StiffnessTable) -> dict[str, Any]:
    result = _without_none(arguments_of(table))
    if result.get("at", 0.0) > arm.length:
        allowed = f"up to the arm's length, {length_text(arm.length)}"
        raise InputError("at", result["at"], allowed)
    if table.tendon_EA is not None and table.hold != "length":
        raise InputError("tendon_EA", table.tendon_EA, 'omitted, unless hold is "length"')
    return result


# Winches


def _winches(arm: Arm, table: SceneTable) -> dict[str, Any]:
    """Return the arguments of settle for winches; empty if the file has tensions only."""
    if table.lengths_mm is None and table.strokes_mm is None:
        for key in ("tendon_EA", "tendon_outside_mm"):
            if getattr(table, key):
                allowed = "omitted without lengths_mm or strokes_mm"
                raise InputError(key, getattr(table, key), allowed)
        return {}
    if table.lengths_mm is not None and table.strokes_mm is not None:
        raise InputError("strokes_mm", Described("given"), "omitted if lengths_mm are given")
    if table.stiffness.tendon_EA is not None:
        item = table.stiffness.tendon_EA
        raise InputError("stiffness.tendon_EA", item, "tendon_EA at the top of the file")
    outside = in_si(table.tendon_outside_mm, "mm")
    lengths: Any = in_si(table.lengths_mm, "mm")
    if table.strokes_mm is not None:
        lengths = _left(arm, in_si(table.strokes_mm, "mm"))
    Winches.of(arm, table.tensions, lengths, table.tendon_EA, outside)
    return {"lengths": lengths, "tendon_outside": outside}


def _left(arm: Arm, strokes: Any) -> list[float]:
    """Return tendon lengths (n_tendons,) [m] for strokes [m]; nan for strokes that are nan.

    Raises InputError for strokes of another shape, and for strokes above the tendon length.
    """
    arm.flat([np.zeros(np.shape(row)).tolist() for row in strokes], "strokes")
    taken = np.hstack([np.ravel(row) for row in strokes])
    rest = rest_lengths(arm)
    for j in np.flatnonzero(np.isinf(taken) | (taken >= rest)):
        field = f"strokes[{j}] ({arm.tendon_name(int(j))})"
        stroke = Described(f"{1e3 * taken[j]:g} mm")
        allowed = f"below {1e3 * rest[j]:.6g} mm, its length at rest; negative to pay out"
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
    """Return the contents of a scene file with an arm, a scene and targets, as decoded TOML.

    Further keyword arguments are keys of scene files; arrays and objects such as obstacles are
    encoded. Raises InputError for objects that have no table.
    """
    more = {key: item for key, item in keys.items() if item is not None}
    table: dict[str, Any] = {"arm": table_of(arm), "effects": table_of(scene or Scene())}
    table |= encode(more)
    if tensions is not None:
        table["tensions"] = encode(tensions)
    if target is not None:
        result = [table_of(item) for item in as_targets(target)]
        table |= {"target": result[0]} if isinstance(target, Target) else {"targets": result}
    if tension_max is not None:
        table["limits"] = {"tension_max": encode(tension_max)} | table.get("limits", {})
    return table


def fill_defaults(raw: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the contents of a scene file with all defaults and meshes as numbers.

    Raises FileError; issues a UnitWarning for each likely slip.
    """
    warn_of_slips(raw)
    return with_defaults(checked_table(raw, name), Path(name).parent)
