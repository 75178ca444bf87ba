"""Compliance of an arm without loads, as a function of its tensions.

A step's pose answers to the twists z = (kappa, nu) at its Gauss nodes by J (6, 6 m); by virtual
work a wrench W on the arm beyond acts on them by J^T W, spread over the nodes' shares w of the
arc. With S the compliance of the section at a node,

    C = sum J S / w J^T

which is the exact compliance of the discretised arm, and symmetric where S is. Lengths of tendons
answer by their own slopes G = d|c| / dz.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.integrators.magnus import MAGNUS6, Magnus
from model.machine.buffered import Buffered
from model.mesh import Mesh, graded
from model.rotations import matrix
from model.scene import Scene
from model.statics import LoadedStatics, loaded_statics_of
from model.statics.algebra import solve_symmetric
from model.stations import crossing, stations
from model.unloaded.closed_form import (
    base_pose,
    closed_statics,
    nodes_of,
    sections,
    strain_function,
    twist,
)
from model.unloaded.step_twist import chain_function, step_slopes
from model.unloaded.strain_derivatives import block_diagonal


class ClosedCompliance:
    """The slopes of a closed-form scene at arc length `at`, on one mesh.

    Attributes
    ----------
    function : casadi.Function
        tensions (n,) -> compliance (6, 6), pose per tension (6, n), and with `lengths`, lengths
        (n,), lengths per wrench (n, 6), lengths per tension (n, n); see sensitivity.Answers.
    call : Buffered
        The same for numbers.
    """

    def __init__(
        self, arm: Arm, scene: Scene, mesh: Mesh, scheme: Magnus, at: float, lengths: bool
    ) -> None:
        n, m = arm.n_tendons, len(scheme.nodes)
        steps = mesh.node(at)
        left, right = mesh.s[:-1][: mesh.steps], mesh.s[1:]
        s, active = nodes_of(scheme, left, right), np.repeat(mesh.active, m)
        w = ca.DM((np.diff(mesh.s)[:, None] * np.array(scheme.weights)).ravel()).T
        closed, statics = closed_statics(scene, arm), loaded_statics_of(scene, arm)
        T, inside = ca.MX.sym("T", n), sections(arm, closed, s, active)
        strains = strain_function(closed).map(s.size)(inside.pull(T), inside.data)
        own = sections(arm, statics, s, active)
        S, S_u = section_function(statics).map(s.size)(strains, own.pull(T), own.data)
        S_T = block_diagonal(S_u, 6, statics.n_pull) @ own.map

        h = ca.DM(np.diff(mesh.s)).T
        twists = _twist().map(s.size)(strains)
        poses, slopes = _step(scheme).map(mesh.steps)(ca.reshape(twists, 6 * m, -1), h)
        chain = chain_function().mapaccum(mesh.steps)
        g = ca.horzcat(ca.DM(base_pose(arm)), chain(base_pose(arm), poses))
        seen = _from_base().map(steps)(g[:, :steps], ca.repmat(g[4:, steps], 1, steps))
        J = _products(seen, slopes[:, : 6 * m * steps], steps, m)
        k = 6 * m * steps
        shares = block_diagonal(S / ca.repmat(_wide(w, 6), 6, 1), 6, 6)[:k, :k]
        C = J @ (shares @ J.T)
        outputs = [C, J @ S_T[:k, :]]
        if lengths:
            at_nodes = stations(arm, s, active)
            speed, G = _runs(statics, tuple(i for i, _ in arm.tendons)).map(s.size)(
                strains, ca.DM(at_nodes.y), ca.DM(at_nodes.y_rate)
            )
            crosses = ca.DM(crossing(arm, at_nodes).T)
            counted = ca.reshape(G, n, -1) * _wide(crosses, 6)
            spread = counted * ca.repmat(_wide(w, 6), n, 1)
            drawn = counted[:, :k] @ (block_diagonal(S, 6, 6)[:k, :k] @ J.T)
            outputs += [(speed * crosses) @ w.T, drawn, spread @ S_T]
        self.function = ca.Function("compliance", [T], [ca.densify(v) for v in outputs])
        self.call = Buffered(self.function)


@lru_cache(maxsize=64)
def closed_compliance(
    arm: Arm, scene: Scene, refinement: int, at: float, lengths: bool
) -> ClosedCompliance:
    """Return the compliance at arc length `at` on a mesh of a refinement, built once."""
    return ClosedCompliance(arm, scene, graded(arm, refinement, (at,)), MAGNUS6, at, lengths)


def _wide(values: ca.MX | ca.DM, columns: int) -> ca.MX | ca.DM:
    """Return each column of values repeated so many times."""
    n = values.shape[1]
    return values @ ca.DM(np.repeat(np.eye(n), columns, axis=1))


def _products(seen: ca.MX, slopes: ca.MX, steps: int, m: int) -> ca.MX:
    """Return J (6, 6 m steps), the maps of the steps (6, 6) times their slopes, side by side."""
    blocks = block_diagonal(seen, 6, 6) @ block_diagonal(slopes, 6, 6 * m)
    return ca.DM(np.tile(np.eye(6), steps)) @ blocks


@lru_cache(maxsize=64)
def section_function(statics: LoadedStatics) -> ca.Function:
    """Return (tau, xi, k, q; pull; data) -> slopes of z against the wrench (6, 6) and the pull."""
    e, v, F = ca.SX.sym("e", 4), ca.SX.sym("v", statics.size), ca.SX.sym("F", 3)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    wrench = statics.wrench(v, pull, data)
    z = ca.vertcat(*statics.twist(v, pull, data, F))
    rows = ca.SX(statics.size, 6)
    rows[:3, :3] = ca.SX.eye(3)
    for i, component in enumerate(statics.forces):
        rows[3 + i, 3 + component] = 1
    stiff = ca.jacobian(wrench, v)
    moved = ca.jacobian(z, v) @ solve_symmetric(stiff, ca.horzcat(rows, -ca.jacobian(wrench, pull)))
    moved[:, 3:6] += ca.jacobian(z, F)
    moved[:, 6:] += ca.jacobian(z, pull)
    kappa, nu = _kappa_nu(e)
    at = ca.substitute([ca.densify(moved)], [v, F], [statics.state(kappa, nu), ca.SX.zeros(3)])[0]
    return ca.Function("section", [e, pull, data], [at[:, :6], at[:, 6:]], {"cse": True})


@lru_cache(maxsize=64)
def _runs(statics: LoadedStatics, section: tuple[int, ...]) -> ca.Function:
    """Return (tau, xi, k, q; y, y' of each section) -> |c| of each tendon, its slopes against z."""
    e, z = ca.SX.sym("e", 4), ca.SX.sym("z", 6)
    y, y_rate = (ca.SX.sym(name, max(section) + 1) for name in ("y", "y_rate"))
    kappa, nu = z[:3], z[3:]
    speeds = [
        ca.norm_2(statics.run(j, statics.state(kappa, nu), kappa, nu, y[i], y_rate[i]))
        for j, i in enumerate(section)
    ]
    speed = ca.vertcat(*speeds)
    found = ca.substitute([speed, ca.densify(ca.jacobian(speed, z))], [z], [twist(e)])
    return ca.Function("runs", [e, y, y_rate], found, {"cse": True})


@lru_cache(maxsize=8)
def _twist() -> ca.Function:
    e = ca.SX.sym("e", 4)
    return ca.Function("twist", [e], [twist(e)])


def _kappa_nu(e: ca.SX) -> tuple[ca.SX, ca.SX]:
    z = twist(e)
    return z[:3], z[3:]


@lru_cache(maxsize=64)
def _step(scheme: Magnus) -> ca.Function:
    """Return (twists (6 m,), h) -> pose (7,) of a step, slopes (6, 6 m) of its local twist."""
    z, h = ca.SX.sym("z", 6 * len(scheme.nodes)), ca.SX.sym("h")
    return ca.Function("step", [z, h], step_slopes(scheme, ca.vertsplit(z, 6), h, z), {"cse": True})


@lru_cache(maxsize=8)
def _from_base() -> ca.Function:
    """Return (pose g, point) -> (6, 6): a local (turn, shift) at g as the point's (shift, turn)."""
    g, point = ca.SX.sym("g", 7), ca.SX.sym("point", 3)
    R, lever = matrix(g[:4]), ca.skew(point - g[4:])
    blocks = ca.blockcat([[-lever @ R, R], [R, ca.SX(3, 3)]])
    return ca.Function("from_base", [g, point], [ca.densify(blocks)])
