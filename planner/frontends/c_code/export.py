"""Export of a scene's forward map as C: for machines without Python, CasADi or a heap."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.sections import LEAST_STRETCH
from octoplan.model.forward import checked_accuracy
from octoplan.model.loads import is_loaded
from octoplan.model.rotations import matrices
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, checked_scene, settle
from octoplan.model.shape import Shape
from octoplan.model.stiffness import tip_jacobian_function
from octoplan.model.support.checks import kind, literal
from octoplan.model.support.errors import FileError, InputError
from octoplan.planner.frontends.c_code.inverse import check_inverse, inverse_values
from octoplan.planner.frontends.c_code.maps import steps_source, whole_source
from octoplan.planner.frontends.c_code.source import CSource, Precision, numbers
from octoplan.planner.frontends.io.files import path_of, versions, write_together
from octoplan.planner.plan import Plan

_TEMPLATES = {
    "@NAME@.h": "map.h",
    "test_vector.h": "test_vector.h",
    "main.c": "main.c",
    "Makefile": "Makefile",
}
_PLAN_TEMPLATES = {
    "@NAME@_plan.h": "plan.h",
    "@NAME@_plan.c": "plan.c",
    "plan_vector.h": "plan_vector.h",
    "plan_main.c": "plan_main.c",
    "Makefile": "plan_Makefile",
}
_NAME = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*")
_FINEST_FLOAT = 1e-6
# How well C agrees with Python: positions over the length, frames, derivatives over the largest.
_TOLERANCE: dict[Precision, float] = {"double": 1e-12, "float": 1e-5}
_BYTES: dict[Precision, int] = {"double": 8, "float": 4}
TAKEN = ("main", "test_vector", "plan_main", "plan_vector", "casadi", "null", "jac", "hess")


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    files : tuple of Path
    shape : Shape
        That of the test vector, whose mesh is the map's.
    static_bytes : int
        Of the work arrays.
    """

    files: tuple[Path, ...]
    shape: Shape
    static_bytes: int


def export(
    arm: Arm,
    scene: Scene | None,
    to: str | Path,
    tensions: Any,
    accuracy: float = ACCURACY,
    precision: Precision = "double",
    name: str = "arm",
) -> Exported:
    """Write the map from tensions to the arm's shape, and the tip's Jacobian, as C99.

    Into the folder `to` go NAME.h and NAME.c, a test vector with a main.c that checks it, and a
    Makefile: all of them, or on failure none.

    Parameters
    ----------
    arm, scene : Arm, Scene
    to : path
        The folder.
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first: those that bend the arm most. The mesh is the one that settles them
        to the accuracy, and they are the test vector.
    accuracy : float
        Tip error over arm length that is accepted, from 1e-12 (in single precision 1e-6) to 0.1.
    precision : "double" or "float"
        Of all numbers in C. The functions agree with `settle` and `tip_jacobian` to 1e-12 in double
        and to 1e-5 in single precision: positions over the length, Jacobians over the largest.
    name : str
        Of the files, and what the names in them begin with.

    Raises
    ------
    InputError
        For a scene with loads, which has no explicit map; for what settle refuses; for a precision,
        a name or a folder that is not allowed.
    CollapsedError, ConvergenceError
        As settle does, at the tensions given.
    """
    scene = _checked(arm, scene, precision, name, accuracy)
    shape = settle(arm, tensions, scene, accuracy)
    source = steps_source(shape, precision) or whole_source(shape, precision)
    values = _values(shape, source, precision, name)
    return _written(to, shape, source, values, precision)


def export_plan(
    p: Plan,
    to: str | Path,
    accuracy: float = ACCURACY,
    precision: Precision = "double",
    name: str = "arm",
) -> Exported:
    """Write the inverse of a plan as C99: from the last tensions to those for a target that moved.

    Besides the files of `export`, with the tip's second derivatives, NAME_plan.h and NAME_plan.c go
    into the folder `to`, and a path of targets with a plan_main.c that checks them. The tensions
    are within the plan's limits and of least effort, as plan(near=...) finds them.

    Parameters
    ----------
    p : Plan
        Of one TipPosition that is reached, with limits of each tendon and the norm "2", in a scene
        without loads in which tendons run straight along a straight arm.
    to : path
        The folder.
    accuracy, precision, name
        As in `export`: the mesh is one that settles the plan's tensions to the accuracy. In double
        precision targets are met to 1e-9 of the length on that mesh, in single to 1e-5.

    Raises
    ------
    InputError
        For another plan, naming what is not exported, and as `export` does.
    CollapsedError, ConvergenceError
        As settle does, at the plan's tensions.
    """
    kind("p", p, Plan)
    scene = _checked(p.arm, p.scene, precision, name, accuracy)
    check_inverse(p)
    shape = settle(p.arm, p.tensions, scene, accuracy)
    source = steps_source(shape, precision, twice=True)
    if source is None:
        allowed = "one whose tendons run straight along the straight arm, not as printed"
        raise InputError("scene", scene, f"{allowed}: others' second derivatives are not exported")
    values = _values(shape, source, precision, name) | inverse_values(p, shape, precision)
    values["HESSIAN"] = _template("hessian.c", values)
    values["HESSIAN_DECLARED"] = _template("hessian.h", values)
    return _written(to, shape, source, values, precision, _PLAN_TEMPLATES)


def _written(
    to: str | Path,
    shape: Shape,
    source: CSource,
    values: dict[str, str],
    precision: Precision,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Exported:
    """Write the files of a map, and `more` of them, into a folder."""
    texts = {
        _filled(file, values): _template(template, values)
        for file, template in {**_TEMPLATES, "@NAME@.c": source.template, **more}.items()
    }
    folder = path_of(to, "to")
    _check_free(folder, values["NAME"])
    write_together(folder, {file: text.encode() for file, text in texts.items()})
    written = tuple(folder / file for file in texts)
    used = source.numbers + int(values.get("PLAN_NUMBERS", 0))
    return Exported(written, shape, _BYTES[precision] * used)


def _template(name: str, values: dict[str, str]) -> str:
    text = files("octoplan.planner.frontends.c_code").joinpath("files", name).read_text("utf-8")
    return _filled(text, values)


def _check_free(folder: Path, name: str) -> None:
    """Refuse a folder with another export, whose main.c and Makefile would be lost."""
    parts = [file for file in _TEMPLATES if not file.startswith("@")]
    shared: list[str] = []
    with suppress(OSError):  # a folder that cannot be: writing says why
        if not (folder / f"{name}.h").exists():
            shared = [file for file in parts if (folder / file).exists()]
    if shared:
        message = (
            f"another export is there ({', '.join(shared)} would be overwritten); "
            f"name another folder, such as {folder / name}"
        )
        raise FileError(str(folder), "", message)


def _checked(arm: Arm, scene: Scene | None, precision: Any, name: Any, accuracy: float) -> Scene:
    scene = checked_scene(arm, scene)
    if is_loaded(scene):
        raise InputError(
            "scene",
            scene,
            "a scene without loads, shear and friction: with them the shape is solved for, there "
            "is no explicit map to export",
        )
    literal("precision", precision, Precision)
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.lower() in TAKEN:
        allowed = f"letters, digits and single _ between them, other than {', '.join(TAKEN)}"
        raise InputError("name", name, allowed)
    if precision == "float" and checked_accuracy(accuracy) < _FINEST_FLOAT:
        allowed = f"{_FINEST_FLOAT:g} or above in single precision, which rounds about as much"
        raise InputError("accuracy", accuracy, allowed)
    return scene


def _filled(text: str, values: dict[str, str]) -> str:
    return re.sub("@([A-Z_]+)@", lambda place: values[place[1]], text)


def _values(shape: Shape, source: CSource, precision: Precision, name: str) -> dict[str, str]:
    """Return what fills the places that are marked in the files, by the places' names."""
    written_by = versions()
    mesh = shape.arm, shape.scene, shape.scheme, shape.refinement
    jacobian = np.array(tip_jacobian_function(*mesh)(shape.tensions))
    test_vector = {
        "TEST_TENSION": shape.tensions,
        "TEST_POSITION": shape.states[:, 4:7],
        "TEST_FRAME": matrices(shape.states[:, :4]),
        "TEST_SHIFT": jacobian[:3],
        "TEST_TURN": jacobian[3:],
        "TEST_TOLERANCE": _TOLERANCE[precision],
        "TEST_LENGTH": shape.arm.length,
    }
    return {
        "OCTOPLAN": written_by["octoplan"],
        "CASADI": written_by["casadi"],
        "NAME": name,
        "NAME_UPPER": name.upper(),
        "REAL": precision,
        "LENGTH": f"{shape.arm.length:g}",
        "SCENE": " ".join(repr(shape.scene).split()),
        "SCHEME": shape.scheme,
        "ERROR": f"{shape.error:.1e}",
        "TENDONS": str(shape.arm.n_tendons),
        "NODES": str(shape.s.size),
        "S": numbers(shape.s, precision),
        "NUMBERS": str(source.numbers),
        "LEAST_STRETCH": numbers(LEAST_STRETCH, precision),
        "HESSIAN": "",
        "HESSIAN_DECLARED": "",
        **source.code(f"{name}.c", precision),
        **{place: numbers(value, precision) for place, value in test_vector.items()},
    }
