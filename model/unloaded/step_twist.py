"""How the pose across a Magnus step answers to the twists at its nodes.

A step is exp(Omega). A change of it moves the step's end by a twist z = (rotation, shift) in the
frame of its start: exp(Omega) becomes exp(z) exp(Omega).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.integrators.magnus import Magnus
from model.rotations import compose, conjugate, exponential, matrix, multiply


def step_jacobian(scheme: Magnus, twists: list[ca.SX], h: ca.SX, e: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pose (7,) of a step, and the derivatives (6, n) of its z against e (n,).

    `twists` (6,) at the scheme's nodes are expressions of e.
    """
    omega = scheme.expansion(twists, h)
    pose, jacobian = _exponential_jacobian()(omega)
    return pose, ca.densify(jacobian @ ca.jacobian(omega, e))


@lru_cache(maxsize=1)
def _exponential_jacobian() -> ca.Function:
    """Return Omega (6,) -> exp(Omega) (7,), derivatives of z against Omega (6, 6)."""
    omega = ca.SX.sym("omega", 6)
    pose = exponential(omega[:3], omega[3:])
    columns = []
    for change in ca.horzsplit(ca.jacobian(pose, omega)):
        rotation = 2 * multiply(change[:4], conjugate(pose[:4]))[1:]
        columns.append(ca.vertcat(rotation, change[4:] - ca.cross(rotation, pose[4:])))
    return ca.Function("jacobian", [omega], [pose, ca.horzcat(*columns)], {"cse": True})


@lru_cache(maxsize=8)
def adjoint_function() -> ca.Function:
    """Return pose -> (6, 6), the map of local twists to spatial ones."""
    g = ca.SX.sym("g", 7)
    R = matrix(g[:4])
    return ca.Function(
        "adjoint", [g], [ca.densify(ca.blockcat([[R, ca.SX(3, 3)], [ca.skew(g[4:]) @ R, R]]))]
    )


@lru_cache(maxsize=1)
def chain_function() -> ca.Function:
    """Return (pose, relative pose) -> the pose after it."""
    g, h = ca.SX.sym("g", 7), ca.SX.sym("h", 7)
    return ca.Function("chain", [g, h], [compose(g, h)])
