"""A map of any kind as C: the functions of all tensions at once that Python calls too."""

from __future__ import annotations

import casadi as ca

from model.effects import ExactTendons
from model.errors import InputError
from model.forward import explicit_map
from model.shape import Shape
from model.stiffness import tip_jacobian_function
from planner.c_code.source import CSource, Precision, frame_function, work_of


def whole_source(shape: Shape, precision: Precision) -> CSource:
    """Return the map of a shape's mesh; its work arrays grow with the number of steps.

    Poses are positions (3, N) and frames (9, N), column by column those of one node, and with them
    goes 1 + q. Raises InputError in single precision where sections settle by Newton's method.
    """
    if precision == "float" and shape.scene.has(ExactTendons):
        allowed = "double with ExactTendons or NeoHookean where tendons run in curves"
        raise InputError("precision", precision, allowed)
    arm, scene, mesh = shape.arm, shape.scene, (shape.scheme, shape.refinement)
    forward, frame = explicit_map(arm, scene, *mesh), frame_function()
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    tip, frames = poses[:, -1], frame.map(poses.shape[1])(poses[:4, :])
    functions = (
        ca.Function("tip_pose", [T], [tip[4:], frame(tip[:4]), stretch]),
        ca.Function("node_poses", [T], [poses[4:, :], frames, stretch]),
        ca.Function("tip_rows", [T], [tip_jacobian_function(arm, scene, *mesh)(T).T]),
    )
    stretches = stretch.numel()
    used = stretches + work_of(functions)["SZ_W"]
    return CSource("whole.c", functions, {"STRETCHES": str(stretches)}, used)
