"""What is exported: the functions, laid out for C, and what fills the places of its files."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import explicit_map
from model.rotations import matrices, matrix
from model.scene import Scene
from model.shape import Shape
from model.tip_slopes import tip_slopes
from planner.c_code import Precision, c_code, numbers, work_of
from planner.report import versions

# How well C agrees with Python: positions over the length, frames, slopes over the largest.
TOLERANCE: dict[Precision, float] = {"double": 1e-12, "float": 1e-5}
BYTES: dict[Precision, int] = {"double": 8, "float": 4}


@lru_cache(maxsize=16)
def _functions(arm: Arm, scene: Scene, scheme: str, refinement: int) -> tuple[ca.Function, ...]:
    """Return tip pose, poses at nodes and tip slopes of tensions, laid out row by row for C.

    The poses are positions (3, N) and frames (9, N), column by column those of one node, and with
    them goes 1 + q.
    """
    forward = explicit_map(arm, scene, scheme, refinement)
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    tip = poses[:, -1]
    return (
        ca.Function("tip_pose", [T], [tip[4:], _frame()(tip[:4]), stretch]),
        ca.Function(
            "node_poses", [T], [poses[4:, :], _frame().map(poses.shape[1])(poses[:4, :]), stretch]
        ),
        ca.Function("tip_rows", [T], [tip_slopes(arm, scene, scheme, refinement)(T).T]),
    )


@lru_cache(maxsize=1)
def _frame() -> ca.Function:
    """Return q -> its rotation matrix (9,), row by row."""
    q = ca.SX.sym("q", 4)
    return ca.Function("frame", [q], [ca.vec(matrix(q).T)], {"cse": True})


def static_bytes(shape: Shape, precision: Precision) -> int:
    """Return the size of the static work arrays."""
    return BYTES[precision] * _numbers(_functions_of(shape))


def c_values(shape: Shape, precision: Precision, name: str) -> dict[str, str]:
    """Return what fills the places that are marked in the files, by the places' names."""
    functions = _functions_of(shape)
    work, written_by = work_of(functions), versions()
    return {
        "OCTOPLAN": written_by["octoplan"],
        "CASADI": written_by["casadi"],
        "NAME": name,
        "NAME_UPPER": name.upper(),
        "REAL": precision,
        "LENGTH": f"{shape.arm.length:g}",
        "SCENE": repr(shape.scene),
        "SCHEME": shape.scheme,
        "ERROR": f"{shape.error:.1e}",
        "TENDONS": str(shape.arm.n_tendons),
        "NODES": str(shape.s.size),
        "S": numbers(shape.s, precision),
        "CODE": c_code(functions, f"{name}.c", precision).strip(),
        "NUMBERS": str(_numbers(functions)),
        "STRETCHES": str(functions[0].numel_out(2)),
        "SZ_W": str(work.w),
        "SZ_IW": str(work.iw),
        "SZ_ARG": str(work.arg),
        "SZ_RES": str(work.res),
        **_test_vector(shape, precision),
    }


def _test_vector(shape: Shape, precision: Precision) -> dict[str, str]:
    """Return what Python finds at the shape's tensions."""
    slopes = np.array(
        tip_slopes(shape.arm, shape.scene, shape.scheme, shape.refinement)(shape.tensions)
    )
    values = {
        "TEST_TENSION": shape.tensions,
        "TEST_POSITION": shape.states[:, 4:7],
        "TEST_FRAME": matrices(shape.states[:, :4]),
        "TEST_SHIFT": slopes[:3],
        "TEST_TURN": slopes[3:],
        "TEST_TOLERANCE": TOLERANCE[precision],
        "TEST_LENGTH": shape.arm.length,
    }
    return {place: numbers(value, precision) for place, value in values.items()}


def _numbers(functions: tuple[ca.Function, ...]) -> int:
    """Return how many numbers the static work arrays hold."""
    return work_of(functions).w + functions[0].numel_out(2)


def _functions_of(shape: Shape) -> tuple[ca.Function, ...]:
    return _functions(shape.arm, shape.scene, shape.scheme, shape.refinement)
