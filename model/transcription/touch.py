"""Kernels of contact: forces at nodes, pressure between them, and what vanishes of either or gap.

At a node that touches an obstacle of signed distance d, with n = grad d at the midline, the force
P n acts on the arm; between nodes where the arm lies on it the pressure p n per unit reference
length, p linear between the nodes. gap = d(u) - R, along the arm gap' = n . u' - R'.

Where the arm touches at a point, that is where the gap is least, and moves along the arm by x while
this bends: gap' + gap'' x = 0, and the force P n(u + x u') has the moment x u' x P n about the
node. A solution has its node there, x = 0; compliances have what x does in them.

A node has two unknowns: P, and p or x. What vanishes there is told by numbers, so that contact
comes and goes without building anything: P and p where the arm is free; gap, and gap' + gap'' x,
where it touches at a point; gap and gap' at the ends of a part that lies on the obstacle; P and gap
inside of it. So pressure holds the gap shut as a quintic spline interpolates: it is the fourth
derivative of the deflection, with as many values as nodes and four conditions at the ends.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.checks import SMALLEST
from model.cross_section.energy import EnergySection
from model.cross_section.law import CrossSection, join, size
from model.obstacles.base import SIZE, signed_distance
from model.rotations import half_turn, multiply, norm, unit_matrix
from model.transcription.collocation import gauss, rotation_vectors, weighted_sum
from model.transcription.kernels import Kernel

# Numbers of a touch: the obstacle's, radius, its slope, h, and what its rows are told; see touch.
TOLD = 5
TOUCH = SIZE + 3 + TOLD
PRESSURE = SIZE + 2


def swelling(law: CrossSection, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the radius over that at rest, and its derivatives by the strains v (1, n)."""
    at = ca.SX.sym("v", size(law))
    wide = law.width(law.twist(at)[1][0]) if isinstance(law, EnergySection) else ca.SX(1)
    width, jacobian = ca.substitute([wide, ca.jacobian(wide, at)], [at], [v])
    return width, jacobian


def touch(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a node that may touch an obstacle.

    Unknowns: the strains of the element before, q, u, P, p or x. Numbers: see TOUCH; the last are
    1 or 0: a force holds the gap shut, pressure alone does, the node is an end of a part that lies,
    it is a point that moves along the arm; and gap'' there. Rows: what it adds to M and F, and what
    vanishes for the two unknowns.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    P, p, c = ca.SX.sym("P"), ca.SX.sym("p"), ca.SX.sym("c", TOUCH)
    gap, slope, along, normal = _gap(law, m, v, q, u, c)
    held, inside, end, moves, curve = ca.vertsplit(c[-TOLD:])
    second = inside * gap + end * slope + moves * (slope + curve * p)
    rows = [
        -moves * p * P * ca.cross(along, normal),
        -P * (normal + moves * p * (ca.jacobian(normal, u) @ along)),
        held * gap + (1 - held) * P,
        second + (1 - inside - end - moves) * p,
    ]
    return Kernel("touch", ca.vertcat(ca.vec(v), q, u, P, p), c, ca.vertcat(*rows))


def _gap(
    law: CrossSection, m: int, v: ca.SX, q: ca.SX, u: ca.SX, c: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return gap, gap', u' and normal at the end of an element."""
    radius, slope, h = ca.vertsplit(c[SIZE : SIZE + 3])
    end, powers = v @ ca.DM(gauss(m).at(1.0)), np.arange(m)
    rate = v @ ca.DM(powers @ gauss(m).powers) / h
    distance, normal = signed_distance()(u, c[:SIZE])
    wide, widening = swelling(law, end)
    gap = distance - radius * wide
    along = unit_matrix(q) @ law.twist(end)[1]
    gap_slope = ca.dot(normal, along) - slope * wide - radius * (widening @ rate)
    return gap, gap_slope, along, normal


def no_touch() -> Kernel:
    """Return the kernel of the base, which touches nothing: P or p there."""
    P = ca.SX.sym("P")
    return Kernel("no_touch", P, ca.SX(0, 1), P)


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
    return Kernel("pressure", unknowns, c, ca.vertcat(*rows))


# Numbers of the kernel: the obstacle's, mu, r, r per length; what its rows are told by touches, 1
# or 0: a force rubs, traction does by its own law, as at the node before, as at the node beyond,
# the node moves along the arm; and u before (3,).
SCALES, FRICTION_TOLD, BEFORE = 3, 5, 3
FRICTION = SIZE + SCALES + FRICTION_TOLD + BEFORE


def contact_friction(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a node that may slip along an obstacle.

    Unknowns: the strains of the element before, q, u, P, p or x of the node (see touch), p and tau
    of the node before and of that beyond, Q, tau; tau as components in the arm's frames. Numbers:
    see FRICTION. Rows: its contributions to M and F, and the residuals of Q and tau.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    values, near = ca.SX.sym("own", 2), ca.SX.sym("near", 4, 2)
    Q, tau, c = ca.SX.sym("Q", 3), ca.SX.sym("tau", 3), ca.SX.sym("c", FRICTION)
    cuts = [0, SIZE, SIZE + 1, SIZE + 2, SIZE + 3, FRICTION - 3, FRICTION]
    body, mu, r, by_length, history, before = ca.vertsplit(c, cuts)
    held, inside, as_before, as_beyond, moves = ca.vertsplit(history)
    P, p, *around = ca.vertsplit(ca.vertcat(values, near[0, :].T))
    _, normal = signed_distance()(u, body)
    frame = unit_matrix(q)
    along = frame @ law.twist(v @ ca.DM(gauss(m).at(1.0)))[1]
    shift = moves * values[1]

    def within(w: ca.SX, pressed: ca.SX) -> ca.SX:
        w -= normal * ca.dot(normal, w)
        most, result = mu * ca.fmax(pressed, 0), norm(w)
        return ca.if_else(result > most, most / result, 1) * w

    slip = u - before
    traction = inside * (frame.T @ within(frame @ tau - by_length * slip, p))
    ends = zip((as_before, as_beyond), around, ca.horzsplit(near[1:, :]), strict=True)
    for is_end, pressed, rubs in ends:
        traction += is_end * p / ca.fmax(pressed, SMALLEST) * rubs
    rows = [-shift * ca.cross(along, Q), -Q, Q - held * within(Q - r * slip, P)]
    rows.append(tau - traction)
    unknowns = ca.vertcat(ca.vec(v), q, u, values, ca.vec(near), Q, tau)
    return Kernel("contact_friction", unknowns, c, ca.vertcat(*rows))
