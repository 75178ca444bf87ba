"""The gap along the arm, anywhere: its value and two derivatives by arc length."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.cross_section.law import CrossSection, size
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Index
from model.machine.buffered import Mapped
from model.machine.compiled import kernel
from model.obstacles.base import SIZE, with_gradient
from model.paths import Array
from model.rotations import unit_matrix
from model.transcription.collocation import gauss
from model.transcription.system import System
from model.transcription.touch import TOUCH, swelling


def along(system: System, x: Array, s: Array, obstacles: Array | Index) -> Array:
    """Return gap [m], gap' [-] and gap'' [1/m] (N, 3) at arc lengths s (N,), on their base side.

    Each of one of the obstacles (N,), by its number.
    """
    of, mesh = system.of, system.mesh
    poses, v = poses_and_strains(system, x, s)
    m, step = of.form.stages, np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.steps - 1)
    h = np.diff(mesh.s)[step]
    share = (s - mesh.s[step]) / h
    p = np.arange(1, m)
    slopes = p * share[:, None] ** (p - 1) @ gauss(m).powers[1:] / h[:, None]
    stages = x[of.first + of.stages].reshape(-1, m, of.form.strains)[step]
    rate = np.einsum("km,kmn->kn", slopes, stages)
    bodies = system.p[of.equations.numbers_of("touch")].reshape(-1, of.form.contacts, TOUCH)
    radii = np.array(system.arm.outer_radius(s))
    return _along(of.form.law, of.form.machine_code)(
        poses, v, rate, bodies[0, obstacles, :SIZE], radii.T
    )[0]


@lru_cache(maxsize=32)
def _along(law: CrossSection, machine_code: bool) -> Mapped:
    """Return pose, strains, their rates, an obstacle, radius and two derivatives -> gap, ..."""
    g, v, rate = ca.SX.sym("g", 7), ca.SX.sym("v", size(law)), ca.SX.sym("rate", size(law))
    body, radius = ca.SX.sym("body", SIZE), ca.SX.sym("radius", 3)
    distance, normal = with_gradient()(g[4:], body)
    kappa, nu = law.twist(v)
    R = unit_matrix(g[:4])
    u1 = R @ nu
    u2 = R @ (ca.cross(kappa, nu) + ca.jtimes(nu, v, rate))
    bend = ca.jacobian(normal, g[4:])
    wide, widening = swelling(law, v)
    wide1 = widening @ rate
    wide2 = ca.jtimes(wide1, v, rate)
    gap = ca.vertcat(
        distance - radius[0] * wide,
        ca.dot(normal, u1) - radius[1] * wide - radius[0] * wide1,
        ca.dot(normal, u2)
        + ca.dot(u1, bend @ u1)
        - radius[2] * wide
        - 2 * radius[1] * wide1
        - radius[0] * wide2,
    )
    found = ca.Function("along", [g, v, rate, body, radius], [gap], {"cse": True})
    return Mapped(kernel(found, machine_code))
