"""Compliance of an arm without loads at one point, in a single sweep from base to tip.

As in model.response.compliance, but with what is needed of each step alone: a step's twist answers
to the twists z of its Gauss nodes by dexp Omega', so that with S the compliance of the sections
there and w their shares of the arc, it adds

    A (sum Omega'_i S_i / w_i Omega'_i^T) A^T        A = Ad dexp

to the compliance of the base frame's origin, as if the arm reached there.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.integrators.magnus import MAGNUS6, Magnus
from model.machine.buffered import Buffered
from model.mesh import graded
from model.response.compliance import section_function
from model.rotations import compose, exponential, matrix
from model.scene import Scene
from model.statics import ClosedStatics, LoadedStatics, loaded_statics_of
from model.unloaded.closed_form import (
    base_pose,
    closed_statics,
    full_strain,
    nodes_of,
    sections,
    strain_function,
    twist,
)
from model.unloaded.step_twist import dexp

_DERIVATIVES = 2


@lru_cache(maxsize=64)
def give_function(arm: Arm, scene: Scene, refinement: int, at: float) -> Buffered:
    """Return tensions (n_tendons,) -> compliance (6, 6) at arc length `at`, transposed."""
    return Buffered(closed_give(arm, scene, MAGNUS6, refinement, at))


@lru_cache(maxsize=64)
def closed_give(arm: Arm, scene: Scene, scheme: Magnus, refinement: int, at: float) -> ca.Function:
    """Return tensions (n_tendons,) -> compliance (6, 6) at arc length `at`, by a Magnus scheme."""
    mesh = graded(arm, refinement, (at,))
    steps, m = mesh.node(at), len(scheme.nodes)
    s = nodes_of(scheme, mesh.s[:steps], mesh.s[1 : steps + 1])
    active, h = np.repeat(mesh.active[:steps], m), np.diff(mesh.s)[:steps]
    T = ca.MX.sym("T", arm.n_tendons)
    closed, statics = closed_statics(scene, arm), loaded_statics_of(scene, arm)
    at_nodes = sections(arm, statics, s, active)
    start = np.concatenate([base_pose(arm), np.zeros(36)])
    across = _step(closed, statics, scheme).fold(steps)
    found = _strains(closed, statics.n_pull).map(s.size)(at_nodes.pull(T), at_nodes.data)
    given = (found, at_nodes.map @ T, at_nodes.data)
    end = across(start, *(ca.reshape(v, -1, steps) for v in given), ca.DM(h).T)
    return ca.Function("give", [T], [ca.densify(_at_end()(end))])


@lru_cache(maxsize=64)
def _step(closed: ClosedStatics, statics: LoadedStatics, scheme: Magnus) -> ca.Function:
    """Return (pose and compliance (43,), strains, pull, data (each m nodes), h) -> after a step."""
    m, h, before = len(scheme.nodes), ca.SX.sym("h"), ca.SX.sym("before", 43)
    strains = ca.SX.sym("strains", 4, m)
    pull = ca.SX.sym("pull", statics.n_pull, m)
    data = ca.SX.sym("data", statics.n_data, m)
    z = ca.SX.sym("z", 6 * m)
    twists, sections = [], []
    for i in range(m):
        e = _settled(closed, strains[:, i], pull[: closed.n_pull, i], data[:, i])
        twists.append(twist(e))
        sections.append(section_function(statics)(e, pull[:, i], data[:, i])[0])
    omega = scheme.expansion(ca.vertsplit(z, 6), h)
    slopes = ca.jacobian(omega, z)
    omega, slopes = ca.substitute([omega, slopes], [z], [ca.vertcat(*twists)])
    inner = ca.SX(6, 6)
    for i, S in enumerate(sections):
        slope = slopes[:, 6 * i : 6 * i + 6]
        inner += slope @ ca.sparsify(S) @ slope.T / (h * scheme.weights[i])
    g = before[:7]
    A = _adjoint(g) @ dexp(omega)
    total = ca.reshape(before[7:], 6, 6) + A @ inner @ A.T
    after = ca.vertcat(compose(g, exponential(omega[:3], omega[3:])), ca.vec(total))
    given = [before, ca.vec(strains), ca.vec(pull), ca.vec(data), h]
    return ca.Function("give_step", given, [after], {"cse": True})


@lru_cache(maxsize=64)
def _strains(closed: ClosedStatics, n_pull: int) -> ca.Function:
    """Return (pull, data) -> (tau, xi, k, q), to be taken as numbers: without derivatives.

    Both kinds of statics take the same pull, those with loads after it that of the slopes.
    """
    pull, data = ca.SX.sym("pull", n_pull), ca.SX.sym("data", closed.n_data)
    still = {"is_diff_in": [False, False], "is_diff_out": [False]}
    found = strain_function(closed)(pull[: closed.n_pull], data)
    return ca.Function("strains", [pull, data], [found], still)


def _settled(closed: ClosedStatics, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
    """Return settled strains (tau, xi, k, q) as they are, with derivatives.

    A Newton step from a solution does not change it and has its first derivatives, two steps have
    its second ones: sooner than through all steps that led there.
    """
    kept = [strain[i] for i, name in enumerate(("tau", "xi", "k", "q")) if name in closed.names]
    v, here = closed.unknowns(ca.vertcat(*kept)), ca.SX.sym("v", len(kept))
    R = closed.residual(here, pull, data)
    step = ca.inv_minor(ca.jacobian(R, here)) @ R
    for _ in range(_DERIVATIVES):
        v = v - ca.substitute(step, here, v)
    return full_strain(closed, closed.strain(v), pull, data)


def _adjoint(g: ca.SX) -> ca.SX:
    """Return the map (6, 6) of local twists (turn, shift) at pose g to those at the origin."""
    R = matrix(g[:4])
    return ca.blockcat([[R, ca.SX(3, 3)], [ca.skew(g[4:]) @ R, R]])


@lru_cache(maxsize=1)
def _at_end() -> ca.Function:
    """Return (pose and compliance (43,)) -> the compliance (6, 6) there, (shift, turn) by each."""
    end = ca.SX.sym("end", 43)
    C, back = ca.reshape(end[7:], 6, 6), -ca.skew(end[4:7])
    there = ca.blockcat([[back, ca.SX.eye(3)], [ca.SX.eye(3), ca.SX(3, 3)]])
    return ca.Function("at_end", [end], [there @ C @ there.T])
