"""Kernels of the least energy: what stages, elements and nodes add to it, and its rows."""

from __future__ import annotations

import casadi as ca

from model.cross_section.energy import EnergySection
from model.cross_section.law import CrossSection, body_size, less_rest, size
from model.obstacles.base import SIZE, with_gradient
from model.rotations import half_turn, unit_matrix
from model.transcription.collocation import gauss, rotation_vectors
from model.transcription.element import Form, element
from model.transcription.kernel import Kernel
from model.transcription.layout import POSE


def body_energy(law: EnergySection) -> Kernel:
    """Return the kernel of a stage's energy: strains; weight [m], numbers of the body -> [N m]."""
    v, c = ca.SX.sym("v", size(law)), ca.SX.sym("c", 1 + body_size(law))
    energy = law.energy(less_rest(law, v, c[1:]), c[1:5])
    return Kernel("body_energy", v, c, c[0] * energy)


def dead_loads(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of less the work of dead loads on an element.

    q, strains; h, the resultants of dead forces beyond the stages (3, m) -> - integral of F . u'.
    """
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", size(law), m)
    h, dead = ca.SX.sym("h"), ca.SX.sym("dead", 3, m)
    twists = [law.twist(at) for at in ca.horzsplit(v)]
    turns = rotation_vectors([kappa for kappa, _ in twists], h)[:-1]
    along = [unit_matrix(half_turn(turn)) @ nu for turn, (_, nu) in zip(turns, twists, strict=True)]
    local = ca.horzsplit(unit_matrix(q).T @ dead)
    work = ca.vertcat(*(ca.dot(f, t) for f, t in zip(local, along, strict=True)))
    value = -h * ca.dot(ca.DM(gauss(m).b), work)
    return Kernel("dead_loads", ca.vertcat(q, ca.vec(v)), ca.vertcat(h, ca.vec(dead)), value)


def off_midline() -> Kernel:
    """Return the kernel of less the work of a dead force off the midline: q; offset, force."""
    q, c = ca.SX.sym("q", 4), ca.SX.sym("c", 6)
    return Kernel("off_midline", q, c, -ca.dot(unit_matrix(q) @ c[:3], c[3:]))


def kinematics(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of an element's kinematics: the residuals of the pose at its end."""
    whole = element(Form(law, m, loaded=False))
    return Kernel("kinematics", whole.y, whole.c, whole.r[-POSE:])


def node_gap() -> Kernel:
    """Return the kernel of the gap at a node: u; the obstacle's numbers, the arm's radius."""
    u, c = ca.SX.sym("u", 3), ca.SX.sym("c", SIZE + 1)
    distance, _ = with_gradient()(u, c[:SIZE])
    return Kernel("node_gap", u, c, distance - c[SIZE])
