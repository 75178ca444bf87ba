"""Scenes that are exported, and exported code called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, RestCurvature, Sampled, Scene
from octoplan.model.effects import ExactTendons, Extension

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
NO_DOUBLE = ("-Wdouble-promotion", "-Wfloat-conversion")

TABLE_4 = Arm.from_paper("table-4")
BENT = ((0.0, 0.0, 0.5, 0.0), (4.0, 0.0, 0.0, 0.0), (0.0, 13.0, 0.0, 0.0))
SECTION_52 = Arm.from_paper("section-5.2")
# Tendons that run in curves, three in one section and two in the other.
CURVED = Arm(
    0.3,
    Linear(0.01, 0.005),
    (
        Anchorage(
            0.3, Sampled((0.0, 0.1, 0.2, 0.3), (0.008, 0.008, 0.005, 0.004)), (0.0, 2.0, 4.0)
        ),
        Anchorage(0.15, Linear(0.007, 0.006), (0.0, 3.0)),
    ),
    base_position=(0.1, -0.2, 0.3),
)
# Tendons that end before the tip, not as many in one section as in the other.
SHORT = Arm(
    0.3,
    Linear(0.01, 0.004),
    (
        Anchorage(0.25, Linear(0.008, 0.004), (0.0, 2.0, 4.0)),
        Anchorage(0.1, Linear(0.008, 0.007), (1.0, 3.0)),
    ),
    base_frame=((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
)
# Curved at rest; the tendons of the tip section have different offsets.
BENT_AT_REST = replace(
    SHORT,
    sections=(
        Anchorage(
            0.25,
            (Linear(0.008, 0.004), Linear(0.007, 0.004), Linear(0.008, 0.003)),
            (0.0, 2.0, 4.0),
        ),
        SHORT.sections[1],
    ),
    rest_curvature=RestCurvature(Linear(1.0, -2.0), Linear(-1.0, 3.0)),
)
# Tendons that turn around the midline.
HELICAL = Arm(
    0.2,
    Linear(0.01, 0.01),
    (Anchorage(0.2, Linear(0.006, 0.006), (0.4, 2.5), turn=Linear(0.0, 1.5)),),
    base_position=(0.0, 0.1, 0.0),
)
SCENES: dict[str, tuple[Arm, Scene, Any]] = {
    "bending alone": (TABLE_4, Scene(), BENT),
    "the paper's": (TABLE_4, Scene(Extension()), BENT),
    "as printed": (SECTION_52, Scene.as_printed(), (0.3, 0.0, 0.0, 0.1)),
    "short tendons": (SHORT, Scene(Extension()), (0.6, 0.0, 0.2, 1.0, 0.0)),
    "curved tendons": (CURVED, Scene(Extension()), (0.6, 0.0, 0.2, 1.0, 0.0)),
    "curved at rest": (BENT_AT_REST, Scene(Extension()), (0.6, 0.0, 0.2, 1.0, 0.0)),
    "helical tendons": (HELICAL, Scene(Extension()), (0.5, 0.2)),
}
SETTLING = {
    "exact tendons": (SECTION_52, Scene(ExactTendons()), (0.3, 0.0, 0.0, 0.1)),
    "silicone": (SECTION_52, Scene.silicone(), (0.3, 0.0, 0.0, 0.1)),
}


def gcc() -> str:
    """Return the C compiler; skip the test without a compiler."""
    found = shutil.which("gcc")
    if found is None:
        pytest.skip("gcc is not installed")
    return found


def compiled(folder: Path, *flags: str) -> Path:
    """Return the program that checks the test vector, compiled."""
    program = folder / "check"
    sources = [str(path) for path in sorted(folder.glob("*.c"))]
    _run([gcc(), "-O1", *STRICT, *flags, *sources, "-o", str(program), "-lm"])
    return program


class Library:
    """The functions that NAME.h declares, called through ctypes."""

    def __init__(self, folder: Path, name: str, tendons: int, nodes: int, precision: str) -> None:
        self.path = folder / "lib.so"
        sources = map(str, folder.glob(f"{name}*.c"))
        flags = ("-O0", "-fPIC", "-shared", *STRICT)
        _run([gcc(), *flags, *sources, "-o", str(self.path), "-lm"])
        self._library = ctypes.CDLL(str(self.path))
        self._name, self._tendons, self._nodes = name, tendons, nodes
        self._kind = np.float64 if precision == "double" else np.float32

    def tip(self, T: Any) -> tuple[int, Any, Any]:
        """Return the code, position (3,) and frame (3, 3)."""
        position, frame = np.zeros(3, self._kind), np.zeros((3, 3), self._kind)
        return self._call("tip", T, position, frame), position, frame

    def nodes(self, T: Any) -> tuple[int, Any, Any]:
        """Return the code, positions (N, 3) and frames (N, 3, 3)."""
        position = np.zeros((self._nodes, 3), self._kind)
        frame = np.zeros((self._nodes, 3, 3), self._kind)
        return self._call("nodes", T, position, frame), position, frame

    def jacobian(self, T: Any) -> Any:
        """Return the derivatives (6, n_tendons)."""
        jacobian = np.zeros((6, self._tendons), self._kind)
        self._call("jacobian", T, jacobian)
        return jacobian

    def without_results(self, T: Any) -> int:
        """Return the code of a call that needs no other function."""
        return int(self._function("tip")(self._pointer(self._given(T)), None, None))

    def _call(self, name: str, T: Any, *results: Any) -> int:
        given = self._given(T)
        return int(self._function(name)(*map(self._pointer, (given, *results))))

    def _function(self, name: str) -> Any:
        return getattr(self._library, f"{self._name}_{name}")

    def _given(self, T: Any) -> Any:
        return np.ravel(T).astype(self._kind)

    @staticmethod
    def _pointer(values: Any) -> ctypes.c_void_p:
        return ctypes.c_void_p(values.ctypes.data)


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stderr == ""
