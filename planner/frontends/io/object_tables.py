"""Tables of the arm, the obstacles and the targets of scene files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import structs
from scipy.spatial.transform import Rotation

import octoplan.model.effects
import octoplan.model.extensions.obstacles
import octoplan.planner.targets
from octoplan.model.anchorage import Anchorage, Material, Profile, RestCurvature
from octoplan.model.arm import PAPER_ARMS, PAPER_FRAME, Arm
from octoplan.model.effects.base import Effect
from octoplan.model.extensions import public_extensions as model_extensions
from octoplan.model.extensions.cross_sections import Rectangle, SectionStiffness, Tube
from octoplan.model.extensions.obstacles import Box, Mesh, Moving
from octoplan.model.extensions.obstacles.base import Convex, Obstacle
from octoplan.model.support.errors import Described, FileError, InputError
from octoplan.model.support.value import Vector
from octoplan.planner.extensions import public_extensions as planner_extensions
from octoplan.planner.frontends.io.codec import (
    READ,
    WRITE,
    FieldFormat,
    Table,
    arguments,
    arguments_of,
    choice,
    encode,
    hints_of,
    in_si,
    quantity,
    read,
    suffix,
    table_of,
    unit_of_type,
)
from octoplan.planner.frontends.io.tables import TABLES, fields_of, struct, table, type_in_file
from octoplan.planner.targets import Softest, Stiffest, Target

Frame = tuple[tuple[float, ...], ...]
Numbers = tuple[float, ...]
# Largest deviation of frame vectors from orthonormality: vectors may be rounded to three digits.
_ROUNDED = 2e-3
VECTOR: Any = type_in_file(Vector)


def frame(tangent: Numbers, normal: Numbers, place: str = "") -> Frame:
    """Return the frame (3, 3) with columns t, n and t x n, row by row.

    Vectors may be rounded to three digits; larger deviations from orthonormality raise InputError.
    `place` is the key path of the table in front of both keys.
    """
    t = np.array(tangent)
    n = np.array(normal)
    for key, vector in (("tangent", t), ("normal", n)):
        if not abs(np.linalg.norm(vector) - 1) < _ROUNDED:
            raise InputError(f"{place}{key}", vector.tolist(), "a vector of length 1")
    if not abs(t @ n) < _ROUNDED:
        allowed = f"a vector at right angles to tangent = {t.tolist()}"
        raise InputError(f"{place}normal", n.tolist(), allowed)
    t = t / np.linalg.norm(t)
    n = n - (t @ n) * t
    n = n / np.linalg.norm(n)
    columns = np.column_stack([t, n, np.cross(t, n)])
    return tuple(tuple(row) for row in columns.tolist())


def columns_of(matrix: Frame) -> dict[str, Any]:
    """Return the keys of a frame: columns t and n."""
    t, n, _ = np.array(matrix).T.tolist()
    return {"tangent": t, "normal": n}


def keyed(of: Any, about: str, *default: Any, unit: str = "") -> Any:
    """Return the type of a key, and a default if there is one."""
    return Annotated[of, quantity(about, unit)], *default


def frame_form(tangent: str, normal: str, *default: Numbers) -> FieldFormat:
    """Return the format of a frame: two keys for columns t and n, with descriptions."""
    about = {"tangent": tangent, "normal": normal}
    keys: dict[str, Any] = {
        key: keyed(VECTOR, f"{item}, of length 1", *default[i : i + 1])
        for i, (key, item) in enumerate(about.items())
    }
    return FieldFormat(keys, frame, columns_of)


_COLUMNS = frame_form("t, along the arm", "n, across the arm and towards tendon 1")
FrameTable: Any = struct(
    "FrameTable",
    [(key, *held) for key, held in _COLUMNS.keys.items()],
    "A frame by its columns t and n; b is their cross product.",
)


def _base(value: Any, rotation_deg: Numbers) -> Frame:
    base: Frame = PAPER_FRAME
    if value is not None:
        base = frame(value.tangent, value.normal, "base_frame.")
    if not any(rotation_deg):
        return base
    rotated = np.array(base) @ Rotation.from_rotvec(np.radians(rotation_deg)).as_matrix()
    return tuple(tuple(row) for row in rotated.tolist())


_ROTATION = "rotation vector about t, n, b that is applied to base_frame"
_BASE = FieldFormat(
    {
        "base_frame": keyed(FrameTable | None, "frame of the base; the paper's by default", None),
        "base_rotation_deg": keyed(VECTOR, _ROTATION, (0.0, 0.0, 0.0), unit="deg"),
    },
    _base,
    lambda item: {"base_frame": columns_of(item)},
)


def _inline(kind: Any) -> FieldFormat:
    """Return the format of an argument whose own arguments are keys of the enclosing table."""
    keys = {
        name + suffix(unit_of_type(type_)): (type_, default)
        for name, type_, default in fields_of(kind, {})
    }
    hints = [hints_of(kind)[name] for name in arguments(kind)]
    table(kind)
    return FieldFormat(keys, lambda *each: kind(*map(read, hints, each)), table_of)


def tag_of(kind: type) -> str:
    """Return the value of the key `type` for a class: tip-position for TipPosition."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", kind.__name__).lower()


_PRESETS = {name: Arm.from_paper(name) for name in PAPER_ARMS}
Preset: Any = Literal[tuple(_PRESETS)]
TABLES[RestCurvature] = table(RestCurvature)
TABLES[Anchorage] = table(Anchorage)
TABLES[Profile] = choice(
    [table(kind, tag=tag_of(kind)) for kind in (Tube, Rectangle, SectionStiffness)]
)
_PRESET = "an arm of the paper; replaces length_mm, radius_mm and sections"
ArmTable: Any = table(
    Arm,
    more={"preset": keyed(Preset | None, _PRESET, None)},
    material=_inline(Material),
    base_frame=_BASE,
)


def arm_of(argument: Any) -> Arm:
    """Return the arm of a table; raise InputError with a key or a field of Arm."""
    required = {key: getattr(argument, key) for key in ("length_mm", "radius_mm", "sections")}
    missing = [key for key, value in required.items() if not value]
    if argument.preset is not None and len(missing) < len(required):
        allowed = "omitted if length_mm, radius_mm or sections are given"
        raise InputError("preset", argument.preset, allowed)
    if argument.preset is None and missing:
        allowed = f"a preset ({', '.join(_PRESETS)}), or length_mm, radius_mm and sections"
        raise InputError("arm", Described(f"no {', no '.join(missing)}"), allowed)
    result = arguments_of(argument)
    if argument.preset is not None:
        like = _PRESETS[argument.preset]
        result |= {"length": like.length, "radius": like.radius, "sections": like.sections}
    return Arm(**result)


READ[ArmTable] = arm_of


# Obstacles


def public(module: Any) -> list[Any]:
    """Return the classes that a package exports; each class must have a table."""
    exported = (getattr(module, name) for name in module.__all__)
    return [item for item in exported if isinstance(item, type)]


def _vertices(values: list[Numbers] | None, position: Numbers, t: Numbers, n: Numbers) -> Any:
    axes = np.array(frame(t, n))
    origin = np.array(in_si(position, "mm"))
    places = np.array(in_si(values or [], "mm")).reshape(-1, 3)
    return tuple(map(tuple, (places @ axes.T + origin).tolist()))


_EDGES = frame_form("along its first edge", "along its second edge", (1, 0, 0), (0, 1, 0))
_AXES = frame_form("its own x axis", "its own y axis", (1, 0, 0), (0, 1, 0))
_VERTICES = FieldFormat(
    {
        "vertices_mm": keyed(list[VECTOR] | None, "along its own axes", None, unit="mm"),
        "position_mm": keyed(VECTOR, "of its own origin", (0, 0, 0), unit="mm"),
        **_AXES.keys,
    },
    _vertices,
    lambda item: {"vertices_mm": encode(item, "mm")},
)
_FROM = ".stl, .obj, .ply or .off, relative to the folder of the scene file"
_FILE: dict[str, tuple[Any, Any]] = {
    "file": keyed(str | None, _FROM, None),
    "unit": keyed(Literal["mm", "cm", "m", "in"], "unit of the file", "mm"),
}
_OBSTACLE_FORMS: dict[Any, dict[str, Any]] = {
    Box: {"frame": _EDGES},
    Mesh: {"vertices": _VERTICES, "more": _FILE},
}
_KINDS = [
    kind for kind in public(octoplan.model.extensions.obstacles) if kind not in (Obstacle, Moving)
]
_SHAPES = {kind: table(kind, tag=tag_of(kind), **_OBSTACLE_FORMS.get(kind, {})) for kind in _KINDS}


def inline_mesh(value: Any, folder: Path) -> Any:
    """Return the table of an obstacle with the vertices of the mesh file, relative to a folder.

    Raises InputError if both a file and vertices are given, or neither, or the file is unreadable.
    """
    if not isinstance(value, _SHAPES[Mesh]):
        return value
    mesh: Any = value
    numbers = (mesh.vertices_mm is not None, mesh.faces is not None)
    if numbers != ((mesh.file is None,) * 2):
        there = [key for key in ("file", "vertices_mm", "faces") if getattr(mesh, key) is not None]
        raise InputError("file", there, "either a file, or vertices_mm and faces")
    if mesh.file is None:
        return mesh
    try:
        result = Mesh.read(folder / mesh.file, mesh.unit)
    except FileError as reason:
        raise InputError("file", mesh.file, f"a file of a closed mesh: {reason.problem}") from None
    corners = [tuple(item) for item in encode(result.vertices, "mm")]
    faces = [(a, b, c) for a, b, c in result.faces]
    return structs.replace(mesh, file=None, vertices_mm=corners, faces=faces)


def _with_key(
    shape: type[Table], prefix: str, key: str, held: tuple[Any, Any], read: Any
) -> type[Table]:
    """Return the table of an obstacle with an additional key; `read` builds the value from both."""
    name = f"{prefix}{shape.__name__}"
    tag = str(shape.__struct_config__.tag)
    new_table: type[Table] = struct(name, [(key, *held)], shape.__doc__, tag, shape)
    READ[new_table] = lambda table: read(READ[shape](table), getattr(table, key))
    return new_table


def _avoided(obstacle: Obstacle, rows: Any) -> Obstacle | Moving:
    if rows is None:
        return obstacle
    return Moving(obstacle, tuple(row[0] for row in rows), in_si([row[1:] for row in rows], "mm"))


_ROWS = "rows of time [s] and displacement along x, y, z [mm]"
_PATH = keyed(tuple[tuple[float, float, float, float], ...] | None, _ROWS, None)
_CONVEX = [_SHAPES[kind] for kind in _KINDS if issubclass(kind, Convex)]
# Obstacles to wrap or hold; to avoid, possibly moving; to lean on.
TABLES[Convex] = choice(_CONVEX)
ObstacleTable: Any = choice(
    [_with_key(item, "Avoided", "path_s_mm", _PATH, _avoided) for item in _SHAPES.values()]
)


def _moving(each: Moving) -> dict[str, Any]:
    rows = zip(each.times, encode(each.path, "mm"), strict=True)
    return {**table_of(each.obstacle), "path_s_mm": [[t, *x] for t, x in rows]}


WRITE[Moving] = _moving


def _register_effect_of_obstacle(kind: type[Effect]) -> None:
    """Register the table of an effect: an obstacle with one more key, such as that of Contact."""
    ((key, *held),) = fields_of(kind, {"obstacle"})
    tables = [_with_key(item, kind.__name__, key, (held[0], held[1]), kind) for item in _CONVEX]
    TABLES[kind] = choice(tables)
    WRITE[kind] = lambda item: {**table_of(item.obstacle), key: getattr(item, key)}


for _module in model_extensions():
    for _kind in public(_module):
        if issubclass(_kind, Effect) and hints_of(_kind).get("obstacle") is Convex:
            _register_effect_of_obstacle(_kind)


def _stiffness(direction: Numbers | None, matrix: Any) -> Any:
    if (direction is None) == (matrix is None):
        inputs = "neither" if matrix is None else "both"
        raise InputError("minimum-stiffness", inputs, "either a direction or a matrix")
    return matrix if direction is None else direction


_MATRIX = "symmetric and positive definite; replaces direction"
_AGAINST: dict[str, tuple[Any, Any]] = {
    "direction": keyed(VECTOR | None, "in the base frame", None),
    "matrix": keyed(tuple[VECTOR, VECTOR, VECTOR] | None, _MATRIX, None),
}
_ABOUT = "about the centre of the object; if omitted, other supports balance the moment"
_WRENCH: dict[str, Any] = {
    "force": keyed(VECTOR, "on the object, in the base frame", unit="N"),
    "moment": keyed(VECTOR | None, _ABOUT, None, unit="N m"),
}


# Forms of fields by the name of the target: extensions may be left out.
_TARGET_FORMS: dict[str, dict[str, Any]] = {
    "TipPose": {"frame": frame_form("desired t of the tip", "desired n of the tip, normal to t")},
    "MinimumStiffness": {
        "direction": FieldFormat(
            _AGAINST,
            _stiffness,
            lambda each: {"matrix" if np.ndim(each) == 2 else "direction": np.array(each).tolist()},
        )
    },
    "Hold": {
        "wrench": FieldFormat(
            _WRENCH,
            lambda force, moment: (*force, *(moment or ())),
            lambda each: {"force": list(each[:3]), "moment": list(each[3:]) or None},
        )
    },
}
_TABLES = {
    kind: table(kind, tag=tag_of(kind), **_TARGET_FORMS.get(kind.__name__, {}))
    for module in (octoplan.planner.targets, *planner_extensions())
    for kind in public(module)
    if hasattr(kind, "terms") and kind is not Target
}
TARGETS = tuple(_TABLES)
TargetTable: Any = choice(list(_TABLES.values()))
ObjectiveTable: Any = choice([_TABLES[Stiffest], _TABLES[Softest]])
