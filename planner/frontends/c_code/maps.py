"""The map from tensions to shape as C functions, with tables of constants.

If pull is a polynomial of arc length, the map is a loop over functions of one step: the work arrays
contain one step, for any number of steps. Other maps are exported as a single function of all
tensions, the function that Python evaluates.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from octoplan.model.cross_section.statics import ClosedStatics, EnergyStatics, closed_statics
from octoplan.model.effects import ExactTendons
from octoplan.model.equilibrium.explicit import ClosedForm
from octoplan.model.forward import explicit_map
from octoplan.model.mesh import base_pose, stations
from octoplan.model.paths import Array
from octoplan.model.rotations import compose
from octoplan.model.shape import Shape
from octoplan.model.stiffness import tip_jacobian_function
from octoplan.model.support.errors import InputError
from octoplan.planner.frontends.c_code.derivatives import (
    TERMS,
    PullPolynomials,
    own_step,
    strain_function,
    twist,
    twist_step,
)
from octoplan.planner.frontends.c_code.source import (
    CSource,
    Precision,
    frame_function,
    numbers,
    whole_numbers,
    work_of,
)

# Tolerance of Newton's method in single precision: the steps decrease quadratically to this size,
# and rounding ends at about 1e-6.
_SETTLED_FLOAT = 1e-4


def steps_source(shape: Shape, precision: Precision, twice: bool = False) -> CSource | None:
    """Return the map of a shape's mesh; None if pull is not a polynomial of arc length.

    With `twice`, include the second derivatives of the tip.
    """
    arm = shape.arm
    scene = shape.scene
    forward = explicit_map(arm, scene, shape.refinement)
    if not isinstance(forward, ClosedForm):
        return None
    statics = closed_statics(scene, arm)
    if precision == "float" and isinstance(statics, EnergyStatics):
        # Use a tolerance that Newton's method reaches in this precision.
        statics = replace(statics, settled=_SETTLED_FLOAT)
    polynomials = PullPolynomials.of(arm, statics)
    if polynomials is None:
        return None
    tables = _tables(forward, statics, polynomials)
    places = {
        **_sizes(forward, statics),
        **{name: numbers(table, precision) for name, table in tables.items()},
        "CROSSING": whole_numbers([*forward.mesh.active, 0]),
        "END_CROSSING": whole_numbers(forward.mesh.segment_ends()[1]),
    }
    rows = len(arm.sections)
    n = TERMS * statics.n_pull
    coefficients = (rows + 1) * n
    states = 2 * (7 + 6 * n)
    sums = rows * 6 * n
    functions = _functions(forward, statics, polynomials)
    if not twice:
        return CSource("steps.c", functions, places, coefficients + states + sums)
    parts = [np.array(part).T for part in polynomials.own]
    places["OWN"] = numbers(np.vstack(parts), precision)
    places["SECTION_OF"] = whole_numbers([i for i, _ in arm.tendons])
    functions = (*functions, own_step(statics, forward.scheme))
    at_nodes = statics.n_pull * len(forward.scheme.nodes)
    seconds = (1 + rows) * n * (n + 1) // 2 + 12 * n + 36 + at_nodes * (at_nodes + n)
    return CSource("steps.c", functions, places, coefficients + states + sums + seconds)


def _sizes(forward: ClosedForm, statics: ClosedStatics) -> dict[str, str]:
    m = len(forward.scheme.nodes)
    sizes = {
        "SEGMENTS": forward.mesh.segment_ends()[1].size // 2,
        "SECTIONS": len(forward.arm.sections),
        "POINTS": m,
        "COEFFICIENTS": TERMS * statics.n_pull,
        "BASIS_SIZE": TERMS * m,
        "BODY_SIZE": statics.n_data * m,
    }
    return {name: str(size) for name, size in sizes.items()}


def _functions(
    forward: ClosedForm, statics: ClosedStatics, polynomials: PullPolynomials
) -> tuple[ca.Function, ...]:
    """Return the functions of the loop; pull is given by coefficients (n_pull TERMS,) and basis."""
    arm = forward.arm
    scheme = forward.scheme
    m = len(scheme.nodes)
    T = ca.MX.sym("T", arm.n_tendons)
    c = ca.SX.sym("c", statics.n_pull * TERMS)
    basis = ca.SX.sym("basis", TERMS, m)
    data = ca.SX.sym("data", statics.n_data, m)
    h = ca.SX.sym("h")
    g = ca.SX.sym("g", 7)
    coefficients = ca.reshape(c, statics.n_pull, TERMS)
    pull = coefficients @ basis
    cse = {"cse": True}
    carried = [ca.vec(ca.densify(column)) for column in polynomials.carried(T)]
    strain = strain_function(statics)
    strains = [strain(pull[:, i], data[:, i]) for i in range(m)]
    pose = compose(g, scheme.step([twist(one) for one in strains], h))
    stretch = ca.vertcat(*(1 + one[3] for one in strains))
    end = 1 + strains[0][3]
    return (
        ca.Function("carried", [T], [ca.horzcat(*carried)]).expand(),
        ca.Function("end_stretch", [c, basis[:, 0], data[:, 0]], [end]),
        ca.Function("pose_step", [g, c, basis, data, h], [pose, stretch], cse),
        ca.Function("placed", [g], [g[4:], frame_function()(g[:4])], cse),
        twist_step(statics, scheme),
        _rows(polynomials),
    )


def _rows(polynomials: PullPolynomials) -> ca.Function:
    """Return the function (pose, sums up to each section's end) -> tip Jacobian, row-major."""
    n = 6 * polynomials.own[0].shape[0]
    pose = ca.SX.sym("pose", 7)
    sums = ca.SX.sym("sums", n, len(polynomials.own))
    columns = [
        ca.reshape(sums[:, i], 6, -1) @ ca.DM(each) for i, each in enumerate(polynomials.own)
    ]
    twists = ca.horzcat(*columns)
    turns = twists[:3, :]
    jacobian = ca.vertcat(twists[3:, :] - ca.skew(pose[4:]) @ turns, turns)
    return ca.Function("tip_rows", [pose, sums], [ca.densify(jacobian).T], {"cse": True})


def _tables(
    forward: ClosedForm, statics: ClosedStatics, polynomials: PullPolynomials
) -> dict[str, Array]:
    """Return the constants of the steps and of the ends of segments, one row each."""
    arm = forward.arm
    mesh = forward.mesh
    scheme = forward.scheme
    ends, at_ends = mesh.segment_ends()
    s, _, active = mesh.points(len(scheme.nodes))
    return {
        "BASE": base_pose(arm),
        "LENGTHS": np.diff(mesh.s),
        "BASIS": polynomials.basis(s).T,
        "BODY": statics.data(arm, forward.scene, stations(arm, s, active)),
        "END_BASIS": polynomials.basis(ends).T,
        "END_BODY": statics.data(arm, forward.scene, stations(arm, ends, at_ends)),
    }


def whole_source(shape: Shape, precision: Precision) -> CSource:
    """Return the map of a shape's mesh; work arrays grow with the mesh.

    Results are positions (3, N) and frames (9, N), one column per node, and 1 + q.
    Raises InputError in single precision if cross-sections require Newton's method.
    """
    if precision == "float" and shape.scene.has(ExactTendons):
        allowed = "double with ExactTendons or NeoHookean if tendons are curved"
        raise InputError("precision", precision, allowed)
    arm = shape.arm
    scene = shape.scene
    forward = explicit_map(arm, scene, shape.refinement)
    frame = frame_function()
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    tip = poses[:, -1]
    frames = frame.map(poses.shape[1])(poses[:4, :])
    jacobian = tip_jacobian_function(arm, scene, shape.refinement)
    functions = (
        ca.Function("tip_pose", [T], [tip[4:], frame(tip[:4]), stretch]),
        ca.Function("node_poses", [T], [poses[4:, :], frames, stretch]),
        ca.Function("tip_rows", [T], [jacobian(T).T]),
    )
    stretches = stretch.numel()
    used = stretches + work_of(functions)["SZ_W"]
    return CSource("whole.c", functions, {"STRETCHES": str(stretches)}, used)
