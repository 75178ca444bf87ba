"""Whether every cross-section of a settled shape is at a minimum of its energy, tensions held.

That is Legendre's condition: d(wrench) / d(strain) positive definite, torsion included. Without
loads the sections settle one by one, and it is all that stability asks for; with loads Jacobi's
condition comes besides, see model.response.jacobi.

It can fail for a neo-Hookean body only. The paper's balance has the matrix of the body, positive
definite, and T y2 (1 - d d^T) of each tendon, which is positive semidefinite. Exact tendons add the
second derivatives of T |c|, and where c is linear in the strains, |c| is convex. A neo-Hookean
section takes its tendons inwards as it swells, and its c is not linear.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import NeoHookean
from model.integrators.magnus import MAGNUS6
from model.machine.buffered import Buffered
from model.mesh import graded
from model.scene import Scene
from model.shape import Shape
from model.statics import LoadedStatics, is_loaded, loaded_statics_of
from model.unloaded.closed_form import closed_statics, nodes_of, sections, strain_function, twist


def is_definite(shape: Shape) -> bool:
    """Return whether Legendre's condition holds at all sections that the mesh looks at."""
    if not shape.scene.has(NeoHookean):
        return True
    if not is_loaded(shape.scene):
        return bool(_closed(shape.arm, shape.scene, shape.refinement)(shape.tensions)[0] > 0)
    statics = loaded_statics_of(shape.scene, shape.arm)
    s, strains = shape.s, shape.states[:, 7 : 7 + statics.size]
    active = np.array([sum(section.at >= place for section in shape.arm.sections) for place in s])
    at = sections(shape.arm, statics, s, active)
    pull = np.reshape(np.array(at.map @ shape.tensions), (-1, statics.n_pull)).T
    found = _least_pivot(statics).map(s.size)(strains.T, pull, at.data)
    return bool(np.array(found).min() > 0)


@lru_cache(maxsize=64)
def _closed(arm: Arm, scene: Scene, refinement: int) -> Buffered:
    """Return tensions -> the least pivot at all nodes of Gauss quadrature on a mesh."""
    mesh, statics = graded(arm, refinement), loaded_statics_of(scene, arm)
    s = nodes_of(MAGNUS6, mesh.s[:-1], mesh.s[1:])
    at = sections(arm, statics, s, np.repeat(mesh.active, len(MAGNUS6.nodes)))
    T = ca.MX.sym("T", arm.n_tendons)
    pull = at.pull(T)
    strains = strain_function(closed_statics(scene, arm)).map(s.size)(pull, at.data)
    pivots = _least_pivot(statics).map(s.size)(_state(statics).map(s.size)(strains), pull, at.data)
    return Buffered(ca.Function("pivots", [T], [ca.mmin(pivots)]))


@lru_cache(maxsize=64)
def _least_pivot(statics: LoadedStatics) -> ca.Function:
    """Return (strains that are states, pull, data) -> the least pivot of d(wrench) / d(strain)."""
    v, pull = ca.SX.sym("v", statics.size), ca.SX.sym("pull", statics.n_pull)
    data = ca.SX.sym("data", statics.n_data)
    left = ca.jacobian(statics.wrench(v, pull, data), v)
    pivots = []
    for _ in range(statics.size):
        pivots.append(left[0, 0])
        left = left[1:, 1:] - left[1:, 0] @ left[0, 1:] / left[0, 0]
    return ca.Function("pivot", [v, pull, data], [ca.mmin(ca.vertcat(*pivots))], {"cse": True})


@lru_cache(maxsize=64)
def _state(statics: LoadedStatics) -> ca.Function:
    e = ca.SX.sym("e", 4)
    z = twist(e)
    return ca.Function("state", [e], [statics.state(z[:3], z[3:])])
