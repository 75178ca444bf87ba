"""What fills the places in the exported files."""

from __future__ import annotations

import numpy as np

from model.rotations import matrices
from model.shape import Shape
from model.stiffness import tip_jacobian_function
from planner.c_code.source import CSource, Precision, numbers
from planner.io.files import versions

# How well C agrees with Python: positions over the length, frames, derivatives over the largest.
TOLERANCE: dict[Precision, float] = {"double": 1e-12, "float": 1e-5}
BYTES: dict[Precision, int] = {"double": 8, "float": 4}


def c_values(shape: Shape, source: CSource, precision: Precision, name: str) -> dict[str, str]:
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
        "TEST_TOLERANCE": TOLERANCE[precision],
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
        "HESSIAN": "",
        "HESSIAN_DECLARED": "",
        **source.code(f"{name}.c", precision),
        **{place: numbers(value, precision) for place, value in test_vector.items()},
    }
