"""Export a scene's forward map as C for systems without Python, CasADi or a heap."""

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
from octoplan.model.equilibrium.linearised import AnyEquilibrium
from octoplan.model.forward import ForwardMap, ForwardMaps, checked_accuracy, explicit_map
from octoplan.model.loads import has_explicit_map, is_coupled
from octoplan.model.rotations import matrices
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, checked_scene, settle, settle_on_meshes
from octoplan.model.shape import Shape
from octoplan.model.stiffness import tip_jacobian_function
from octoplan.model.support.checks import kind, literal
from octoplan.model.support.errors import FileError, InputError
from octoplan.planner.frontends.c_code.inverse import check_inverse, inverse_values
from octoplan.planner.frontends.c_code.maps import steps_source, whole_source
from octoplan.planner.frontends.c_code.source import CSource, Precision, numbers
from octoplan.planner.frontends.io.files import path_of, versions, write_together
from octoplan.planner.plan_result import Plan

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
# Smallest accuracy in single precision.
_FINEST_FLOAT = 1e-6
# Agreement of C and Python: positions over the length, frames, derivatives over the largest.
_TOLERANCE: dict[Precision, float] = {"double": 1e-12, "float": 1e-5}
# Size of a number in bytes.
_BYTES: dict[Precision, int] = {"double": 8, "float": 4}
# Reserved names of the generated code.
TAKEN = ("main", "test_vector", "plan_main", "plan_vector", "casadi", "null", "jac", "hess")


@dataclass(frozen=True)
class Exported:
    """The result of an export.

    Attributes
    ----------
    files : tuple of Path
    shape : Shape
        Shape of the test vector; the map has the same mesh.
    static_bytes : int
        Size of the static work arrays.
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
    """Write the map from tensions to the shape of the arm, and the tip Jacobian, as C99.

    The folder `to` receives NAME.h and NAME.c, a test vector, a main.c that checks the test vector,
    and a Makefile: all files, or none on failure.

    Parameters
    ----------
    arm, scene : Arm, Scene
    to : path
        The folder.
    tensions : (n_sections, n) or (n_tendons,)
        Tensions of the test vector [N], tip section first; choose those with the largest bend. The
        mesh of the map is the one that settles them to the accuracy.
    accuracy : float
        Accepted tip error over arm length, 1e-12 (in single precision 1e-6) to 0.1.
    precision : "double" or "float"
        Type of all numbers in C. The functions agree with `settle` and `tip_jacobian` to 1e-12 in
        double and to 1e-5 in single precision: positions over the length, Jacobians over the
        largest entry.
    name : str
        Name of the files, and prefix of the C names.

    Raises
    ------
    InputError
        For a scene with loads and for spacer discs, which have no explicit map; for input that
        settle rejects; for an invalid precision, name or folder.
    CollapsedError, ConvergenceError
        As settle, at the given tensions.
    """
    scene = _checked(arm, scene, precision, name, accuracy)
    shape = _settled(arm, tensions, scene, accuracy)
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
    """Write the inverse of a plan as C99: from the last tensions to those for a moved target.

    The folder `to` receives the files of `export`, with the second derivatives of the tip,
    NAME_plan.h and NAME_plan.c, and a sequence of targets with a test program plan_main.c. The
    tensions are within the limits of the plan and have least effort, as those of plan(near=...).

    Parameters
    ----------
    p : Plan
        Plan of a reached TipPosition, with limits of each tendon and the norm "2", in a scene
        without loads and with tendons parallel to a straight midline.
    to : path
        The folder.
    accuracy, precision, name
        See `export`; the mesh is one that settles the tensions of the plan to the accuracy. On this
        mesh targets are met to 1e-9 of the length in double precision, to 1e-5 in single precision.

    Raises
    ------
    InputError
        For another plan, with the property that is not supported; otherwise as `export`.
    CollapsedError, ConvergenceError
        As settle, at the tensions of the plan.
    """
    kind("p", p, Plan)
    scene = _checked(p.arm, p.scene, precision, name, accuracy)
    check_inverse(p)
    shape = _settled(p.arm, p.tensions, scene, accuracy)
    source = steps_source(shape, precision, twice=True)
    if source is None:
        allowed = "a scene with straight tendons along a straight arm, not as printed"
        raise InputError("scene", scene, f"{allowed}; others have no exported second derivatives")
    values = _values(shape, source, precision, name) | inverse_values(p, shape, precision)
    values["HESSIAN"] = _template("hessian.c", values)
    values["HESSIAN_DECLARED"] = _template("hessian.h", values)
    return _written(to, shape, source, values, precision, _PLAN_TEMPLATES)


class _ExplicitMaps(ForwardMaps):
    """The explicit maps of an arm, one for each mesh."""

    def on(self, refinement: int, at: tuple[float, ...] = ()) -> ForwardMap:
        """Return the explicit map on the mesh of a refinement."""
        return explicit_map(self.arm, self.scene, refinement)


def _settled(arm: Arm, tensions: Any, scene: Scene, accuracy: float) -> Shape:
    """Return the shape on the first mesh of the explicit map that is accurate enough.

    `settle` solves arms with turning tendons by collocation, on other meshes.
    """
    if not is_coupled(arm, scene):
        return settle(arm, tensions, scene, accuracy)
    T = arm.flat(tensions)

    def solve(forward: ForwardMap, near: AnyEquilibrium | None, factor: float) -> AnyEquilibrium:
        return forward.solve(T, near, factor)

    maps = _ExplicitMaps(arm, scene, machine_code=False)
    return settle_on_meshes(maps, solve, checked_accuracy(accuracy), None)


def _written(
    to: str | Path,
    shape: Shape,
    source: CSource,
    values: dict[str, str],
    precision: Precision,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Exported:
    """Write the files of a map, and further files `more`, into a folder."""
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
    """Raise FileError for a folder with another export, which would be partly overwritten."""
    parts = [file for file in _TEMPLATES if not file.startswith("@")]
    shared: list[str] = []
    with suppress(OSError):  # writing reports the error of an invalid folder
        if not (folder / f"{name}.h").exists():
            shared = [file for file in parts if (folder / file).exists()]
    if shared:
        message = (
            f"contains another export ({', '.join(shared)} would be overwritten); "
            f"choose another folder, such as {folder / name}"
        )
        raise FileError(str(folder), "", message)


def _checked(arm: Arm, scene: Scene | None, precision: Any, name: Any, accuracy: float) -> Scene:
    scene = checked_scene(arm, scene)
    if not has_explicit_map(arm, scene):
        raise InputError(
            "scene",
            scene,
            "a scene without loads, shear and friction, for tendons that do not run straight "
            "between guides: the others have no explicit map to export",
        )
    literal("precision", precision, Precision)
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.lower() in TAKEN:
        allowed = f"letters, digits and single _ between them, other than {', '.join(TAKEN)}"
        raise InputError("name", name, allowed)
    if precision == "float" and checked_accuracy(accuracy) < _FINEST_FLOAT:
        allowed = f"at least {_FINEST_FLOAT:g} in single precision, which rounds to this size"
        raise InputError("accuracy", accuracy, allowed)
    return scene


def _filled(text: str, values: dict[str, str]) -> str:
    return re.sub("@([A-Z_]+)@", lambda place: values[place[1]], text)


def _values(shape: Shape, source: CSource, precision: Precision, name: str) -> dict[str, str]:
    """Return the texts for the placeholders in the files, by name."""
    written_by = versions()
    function = tip_jacobian_function(shape.arm, shape.scene, shape.refinement)
    jacobian = np.array(function(shape.tensions))
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
