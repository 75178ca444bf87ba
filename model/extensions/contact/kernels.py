"""Kernels of contact: forces at nodes, pressure between nodes, and the residuals of contact.

An obstacle has the signed distance d and the normal n = grad d at the midline. The gap is
gap = d(u) - R with the radius R of the arm, and along the arm gap' = n . u' - R'. A touching node
receives the force P n. A conforming part of the arm, which follows the surface of the obstacle,
receives the pressure p n per unit reference length; p is linear between nodes.

A contact point is a place of minimal gap. It moves along the arm by x if the arm bends:
gap' + gap'' x = 0. The force P n(u + x u') then has the moment x u' x P n about the node, and
friction acts along the surface. The solution has its node at the contact point, x = 0; compliances
contain the effect of x.

A node has two unknowns: P, and p or x. Parameters (flags) select the two equations of a node, so
that a change of contact needs no new kernel:

- P = 0 and p = 0 at a node without contact;
- gap = 0 and gap' + gap'' x = 0 at a contact point;
- gap = 0 and gap' = 0 at the ends of a conforming part;
- P = 0 and gap = 0 inside a conforming part.

The pressure is the fourth derivative of the deflection. With one value per node and four conditions
at the ends it closes the gap as a quintic spline interpolates.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, EnergySection, join, size
from octoplan.model.extensions.obstacles.base import SIZE, signed_distance
from octoplan.model.rod.collocation import gauss, rotation_vectors, weighted_sum
from octoplan.model.rod.kernels import Kernel
from octoplan.model.rotations import half_turn, multiply, norm, unit_matrix
from octoplan.model.support.checks import SMALLEST
from octoplan.model.support.machine.functions import cached

# Parameters of `touch`: those of the obstacle, the radius of the arm, its slope, h, flags, and with
# friction mu, r and the position u before the step.
# Flags of a node, 1 or 0: a force closes the gap, there is pressure, the node is a contact point
# that moves along the arm, the element beyond is conforming.
FLAGS = slice(SIZE + 3, SIZE + 7)
FRICTION = SIZE + 7
BEFORE = slice(SIZE + 9, SIZE + 12)
PRESSURE = SIZE + 2
# Smallest h gap'': below it a contact point moves towards smaller gaps as if gap'' were 1 / h.
_FLAT = 1e-6
# Largest ratio of the pressures of an end of a part and of its neighbour, for friction: neighbours
# of iterates may be without pressure.
_STEEPEST = 4.0


def touch(law: CrossSection, m: int, friction: bool = False, conforming: bool = False) -> Kernel:
    """Return the kernel of a node that may touch an obstacle, and slip along it with friction.

    Unknowns: the strains of the element before, q, u, P, p or x; with friction the friction Q; if
    parts conform, also p and the traction of the node before and of the node beyond, before Q, and
    the traction tau. Tractions are components in the frames of the arm. Rows: shares of M and F,
    and the residuals of P, p or x, Q and tau. A node with a force and pressure is an end of a
    conforming part. Its traction is the traction of the neighbour inside the part, in proportion to
    the pressure.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    P, p, c = ca.SX.sym("P"), ca.SX.sym("p"), ca.SX.sym("c", SIZE + 7 + 5 * friction)
    radius, slope, h = ca.vertsplit(c[SIZE : SIZE + 3])
    end, rate = v @ ca.DM(gauss(m).at(1.0)), v @ ca.DM(np.arange(m) @ gauss(m).powers) / h
    g, radii = ca.vertcat(q, u), ca.vertcat(radius, slope, 0)
    gaps, normal, along = cached(gap_along, law)(g, end, rate, c[:SIZE], radii)
    gap, gap1, gap2 = ca.vertsplit(gaps)
    held, pressing, moves, lies = ca.vertsplit(c[FLAGS])
    curve, shift = ca.if_else(h * gap2 > _FLAT, gap2, 1 / h), moves * p
    by_pressure = pressing * ((1 - held) * gap + held * gap1)
    turned = normal + shift * (ca.jacobian(normal, u) @ along)
    force = P * turned
    lever, unknowns = P * normal, [ca.vec(v), q, u, P, p]
    rows = [
        held * gap + (1 - held) * P,
        by_pressure + moves * (gap1 + curve * p) + (1 - pressing - moves) * p,
    ]
    if friction:
        Q = ca.SX.sym("Q", 3)
        mu, r, before = ca.vertsplit(c[SIZE + 7 :], [0, 1, 2, 5])
        slip = u - before

        def within(w: ca.SX, pressed: ca.SX) -> ca.SX:
            w -= turned * ca.dot(turned, w)
            most, result = mu * ca.fmax(pressed, 0), norm(w)
            return ca.if_else(result > most, most / result, 1) * w

        rows += [Q - held * within(Q - r * slip, P)]
        unknowns += [Q]
        if conforming:
            frame, near, tau = unit_matrix(q), ca.SX.sym("near", 4, 2), ca.SX.sym("tau", 3)
            traction = (1 - held) * pressing * (frame.T @ within(frame @ tau - r / h * slip, p))
            for side, beside in zip((1 - lies, lies), ca.horzsplit(near), strict=True):
                pressed = ca.fmax(ca.fmax(beside[0], p / _STEEPEST), SMALLEST)
                traction += held * pressing * side * ca.fmax(p, 0) / pressed * beside[1:]
            rows += [tau - traction]
            unknowns += [tau]
            unknowns.insert(-2, ca.vec(near))
        force, lever = force + Q, lever + Q
    rows = [-shift * ca.cross(along, lever), -force, *rows]
    return Kernel("touch", ca.vertcat(*unknowns), {"values": c}, ca.vertcat(*rows))


def gap_along(law: CrossSection) -> ca.Function:
    """Return the function of the gap and its first two derivatives along the arm, normal, and u'.

    Arguments: pose, strains, derivatives of the strains along s, parameters of an obstacle, radius
    of the arm at rest with its first two derivatives (3,). A body of constant volume swells if it
    is shortened.
    """
    g, v, rate = ca.SX.sym("g", 7), ca.SX.sym("v", size(law)), ca.SX.sym("rate", size(law))
    body, radius = ca.SX.sym("body", SIZE), ca.SX.sym("radius", 3)
    distance, normal = signed_distance()(g[4:], body)
    (kappa, nu), R = law.twist(v), unit_matrix(g[:4])
    along = R @ nu
    bend = R @ (ca.cross(kappa, nu) + ca.jtimes(nu, v, rate))
    wide = law.width(nu[0]) if isinstance(law, EnergySection) else ca.SX(1)
    wide1 = ca.jtimes(wide, v, rate)
    wide2 = ca.jtimes(wide1, v, rate)
    normal1 = ca.jacobian(normal, g[4:]) @ along
    gap = ca.vertcat(
        distance - radius[0] * wide,
        ca.dot(normal, along) - radius[1] * wide - radius[0] * wide1,
        ca.dot(normal, bend)
        + ca.dot(along, normal1)
        - radius[2] * wide
        - 2 * radius[1] * wide1
        - radius[0] * wide2,
    )
    return ca.Function("along", [g, v, rate, body, radius], [gap, normal, along], {"cse": True})


def pressure(law: CrossSection, m: int, friction: bool = False) -> Kernel:
    """Return the kernel of an element that may conform to an obstacle.

    Unknowns: q, u, strains, p at both nodes; with friction also the traction at both nodes, as
    components in the frames of the arm, which is linear between the nodes. Parameters: those of the
    obstacle, h, 1 if the element is conforming. Rows: shares of M and F at the first node, then of
    the local wrench at the stages.
    """
    q, u, v = ca.SX.sym("q", 4), ca.SX.sym("u", 3), ca.SX.sym("v", size(law), m)
    p, c, method = ca.SX.sym("p", 2), ca.SX.sym("c", PRESSURE), gauss(m)
    tau = ca.SX.sym("tau", 3 * friction, 2)
    h, lies = c[SIZE], c[SIZE + 1]
    twists = [law.twist(each) for each in ca.horzsplit(v)]
    rotations = rotation_vectors([kappa for kappa, _ in twists], h)[:-1]
    R = [unit_matrix(multiply(q, half_turn(rotation))) for rotation in rotations]
    along = [frame @ nu for frame, (_, nu) in zip(R, twists, strict=True)]
    places = [u + h * weighted_sum(row, along) for row in method.a]
    shares = [lies * ((1 - x) * p[0] + x * p[1]) for x in method.c.tolist()]
    f = [x * signed_distance()(at, c[:SIZE])[1] for x, at in zip(shares, places, strict=True)]
    if friction:
        between = [lies * ((1 - x) * tau[:, 0] + x * tau[:, 1]) for x in method.c.tolist()]
        f = [each + frame @ t for each, frame, t in zip(f, R, between, strict=True)]
    F = [h * weighted_sum(method.b - row, f) for row in method.a]
    levers = [ca.cross(t, force) for t, force in zip(along, F, strict=True)]
    M = [h * weighted_sum(method.b - row, levers) for row in method.a]
    stages = [
        -join(law, frame.T @ moment, *ca.vertsplit(frame.T @ force, [0, 1, 3]))
        for frame, moment, force in zip(R, M, F, strict=True)
    ]
    rows = [-h * weighted_sum(method.b, levers), -h * weighted_sum(method.b, f), *stages]
    unknowns = ca.vertcat(q, u, ca.vec(v), p, ca.vec(tau))
    return Kernel("pressure", unknowns, {"values": c}, ca.vertcat(*rows))
