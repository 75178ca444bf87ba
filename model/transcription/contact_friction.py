"""The kernel of Coulomb friction at a node that touches an obstacle.

With n the obstacle's normal at the midline, P what presses at the node, and d = (I - n n^T)
(u - u_before) how far the midline has slipped along the obstacle since the equilibrium before, the
friction Q on the arm sticks, d = 0 with |Q| <= mu P, or slips, Q = -mu P d / |d|. Both are

    Q = the part of w = (I - n n^T) (Q - r d) within the disc of radius mu P

for any r > 0 (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92, 1991), of which Newton's
method takes the derivatives of the piece that it is in.

Of a part that lies on an obstacle the pressure p rubs between the nodes too: with the traction tau
[N/m], which is as linear there as p, at the nodes inside by the same law, of mu p. What presses at
the part's ends as a force rubs there as one, and the traction at an end is to p as at the node next
to it. So the tension along a part that slips is as smooth as p. With forces at the nodes alone it
would jump at each, and the stretch and curvature with it, which the obstacle prescribes: moments do
not jump.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.cross_section.law import CrossSection, size
from model.obstacles.base import SIZE, with_gradient
from model.rotations import unit_matrix
from model.transcription.collocation import gauss
from model.transcription.kernel import Kernel

# Numbers of the kernel: the obstacle's, mu, r, r per length; what its rows are told by touches, 1
# or 0: a force rubs, traction does by its own law, as at the node before, as at the node beyond,
# the node moves along the arm; and u before (3,).
SCALES, TOLD, BEFORE = 3, 5, 3
FRICTION = SIZE + SCALES + TOLD + BEFORE
# Under a root [N2]; and the least pressure [N/m] that is divided by.
_TINY, _LEAST = 1e-60, 1e-30


@lru_cache(maxsize=32)
def contact_friction(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a node that may slip along an obstacle.

    Unknowns: the strains of the element before, q, u, P, p or x of the node (see touch), p and tau
    of the node before and of that beyond, Q, tau; tau as components in the arm's frames. Numbers:
    see FRICTION. Rows: what it adds to M and F, and what vanishes for Q and tau.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    own, near = ca.SX.sym("own", 2), ca.SX.sym("near", 4, 2)
    Q, tau, c = ca.SX.sym("Q", 3), ca.SX.sym("tau", 3), ca.SX.sym("c", FRICTION)
    cuts = [0, SIZE, SIZE + 1, SIZE + 2, SIZE + 3, FRICTION - 3, FRICTION]
    body, mu, r, by_length, told, before = ca.vertsplit(c, cuts)
    held, inside, as_before, as_beyond, moves = ca.vertsplit(told)
    P, p, *around = ca.vertsplit(ca.vertcat(own, near[0, :].T))
    _, normal = with_gradient()(u, body)
    frame = unit_matrix(q)
    along = frame @ law.twist(v @ ca.DM(gauss(m).at(1.0)))[1]
    shift = moves * own[1]

    def within(w: ca.SX, pressed: ca.SX) -> ca.SX:
        w -= normal * ca.dot(normal, w)
        most, found = mu * ca.fmax(pressed, 0), ca.sqrt(ca.sumsqr(w) + _TINY)
        return ca.if_else(found > most, most / found, 1) * w

    slip = u - before
    traction = inside * (frame.T @ within(frame @ tau - by_length * slip, p))
    ends = zip((as_before, as_beyond), around, ca.horzsplit(near[1:, :]), strict=True)
    for is_end, pressed, rubs in ends:
        traction += is_end * p / ca.fmax(pressed, _LEAST) * rubs
    rows = [-shift * ca.cross(along, Q), -Q, Q - held * within(Q - r * slip, P)]
    rows.append(tau - traction)
    unknowns = ca.vertcat(ca.vec(v), q, u, own, ca.vec(near), Q, tau)
    return Kernel("contact_friction", unknowns, c, ca.vertcat(*rows))
