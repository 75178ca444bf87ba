"""Kernels of contact: forces at nodes, pressure between them, and the residuals of contact.

At a node that touches an obstacle of signed distance d, with n = grad d at the midline, the force
P n acts on the arm; between nodes where the arm lies on it the pressure p n per unit reference
length, p linear between the nodes. gap = d(u) - R, along the arm gap' = n . u' - R'.

Where the arm touches at a point, that is where the gap is least, and moves along the arm by x while
this bends: gap' + gap'' x = 0, and the force P n(u + x u') has the moment x u' x P n about the
node, and friction acts along the surface there. A solution has its node there, x = 0; compliances
have what x does in them.

A node has two unknowns: P, and p or x. What is 0 there is told by numbers, so that contact
comes and goes without building anything: P and p where the arm is free; gap, and gap' + gap'' x,
where it touches at a point; gap and gap' at the ends of a part that lies on the obstacle; P and gap
inside of it. So pressure holds the gap shut as a quintic spline interpolates: it is the fourth
derivative of the deflection, with as many values as nodes and four conditions at the ends.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.cross_section.energy import EnergySection
from octoplan.model.cross_section.law import CrossSection, join, size
from octoplan.model.extensions.obstacles.base import SIZE, signed_distance
from octoplan.model.rod.collocation import gauss, rotation_vectors, weighted_sum
from octoplan.model.rod.kernels import Kernel
from octoplan.model.rotations import half_turn, multiply, norm, unit_matrix
from octoplan.model.support.checks import SMALLEST
from octoplan.model.support.machine.functions import cached

# Numbers of a touch: the obstacle's, radius, its slope, h, flags; with friction mu, r and u before.
# Flags of a node, 1 or 0: a force holds the gap shut, there is pressure, the node is a point that
# moves along the arm, the element beyond lies on the obstacle.
FLAGS = slice(SIZE + 3, SIZE + 7)
BEFORE = slice(SIZE + 9, SIZE + 12)
PRESSURE = SIZE + 2
# Times the element's length h: where gap'' is less points move to lesser gaps, as if it were 1 / h.
_FLAT = 1e-6


def touch(law: CrossSection, m: int, friction: bool = False) -> Kernel:
    """Return the kernel of a node that may touch an obstacle, and with friction slip along it.

    Unknowns: the strains of the element before, q, u, P, p or x; with friction p and tau of the
    node before and of that beyond, Q, tau; tau as components in the arm's frames. Rows: its
    contributions to M and F, and the residuals of P, p or x, Q and tau. Where there is a force and
    pressure the node is an end of a part that lies. Traction there is that of the node beside, in
    proportion to pressure.
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
        near, Q, tau = ca.SX.sym("near", 4, 2), ca.SX.sym("Q", 3), ca.SX.sym("tau", 3)
        mu, r, before = ca.vertsplit(c[SIZE + 7 :], [0, 1, 2, 5])
        frame, slip, around = unit_matrix(q), u - before, ca.horzsplit(near[0, :])

        def within(w: ca.SX, pressed: ca.SX) -> ca.SX:
            w -= turned * ca.dot(turned, w)
            most, result = mu * ca.fmax(pressed, 0), norm(w)
            return ca.if_else(result > most, most / result, 1) * w

        traction = (1 - held) * pressing * (frame.T @ within(frame @ tau - r / h * slip, p))
        ends = zip((1 - lies, lies), around, ca.horzsplit(near[1:, :]), strict=True)
        for side, pressed, rubs in ends:
            traction += held * pressing * side * p / ca.fmax(pressed, SMALLEST) * rubs
        rows += [Q - held * within(Q - r * slip, P), tau - traction]
        unknowns += [ca.vec(near), Q, tau]
        force, lever = force + Q, lever + Q
    rows = [-shift * ca.cross(along, lever), -force, *rows]
    return Kernel("touch", ca.vertcat(*unknowns), {"values": c}, ca.vertcat(*rows))


def gap_along(law: CrossSection) -> ca.Function:
    """Return pose, strains, their rates, an obstacle, radii -> gap and derivatives, normal, u'.

    The gap's first two along the arm, rates those of strains, radii (3,) at rest with theirs. A
    body that keeps its volume swells where it is shortened.
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
    """Return the kernel of an element that may lie on an obstacle.

    Unknowns: q, u, strains; p at both nodes, and with friction the traction there, as components
    in the arm's frames, that is linear between them too. Numbers: the obstacle's, h, 1 if it does.
    Rows: what it adds to M and F at the first node, then to the local wrench at the stages.
    """
    q, u, v = ca.SX.sym("q", 4), ca.SX.sym("u", 3), ca.SX.sym("v", size(law), m)
    p, c, method = ca.SX.sym("p", 2), ca.SX.sym("c", PRESSURE), gauss(m)
    tau = ca.SX.sym("tau", 3 * friction, 2)
    h, lies = c[SIZE], c[SIZE + 1]
    twists = [law.twist(each) for each in ca.horzsplit(v)]
    turns = rotation_vectors([kappa for kappa, _ in twists], h)[:-1]
    R = [unit_matrix(multiply(q, half_turn(turn))) for turn in turns]
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
