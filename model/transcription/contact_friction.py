"""The kernel of Coulomb friction at a node that touches an obstacle.

With n the obstacle's normal at the midline, N what it presses at the node, and d = (I - n n^T)
(u - u_before) how far the midline has slipped along the obstacle since the equilibrium before, the
friction Q on the arm sticks, d = 0 with |Q| <= mu N, or slips, Q = -mu N d / |d|. Both are

    Q = the part of w = (I - n n^T) (Q - r d) within the disc of radius mu N

for any r > 0 (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92, 1991), of which Newton's
method takes the derivatives of the piece that it is in.

N is the force at the node, and of the pressure of a part that lies on the obstacle what falls to
the node by the lever rule: friction acts at nodes, and converges as these come closer.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.cross_section.law import CrossSection, size
from model.obstacles.base import SIZE, with_gradient
from model.rotations import unit_matrix
from model.transcription.collocation import gauss
from model.transcription.kernel import Kernel

# Numbers of the kernel: the obstacle's, mu, r; what its rows are told by touches: 1 or 0 for a node
# that touches, is held by a force, moves along the arm, weights of pressure [m]; and u before (3,).
SCALES, TOLD, BEFORE = 2, 6, 3
FRICTION = SIZE + SCALES + TOLD + BEFORE
# Under a root [N2].
_TINY = 1e-60


@lru_cache(maxsize=32)
def contact_friction(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a node that may slip along an obstacle.

    Unknowns: the strains of the element before, q, u, P, p or x of the node (see touch), p at the
    nodes before and beyond, Q. Numbers: see FRICTION. Rows: what it adds to M and F, and what
    vanishes for Q.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    own, near, Q = ca.SX.sym("own", 2), ca.SX.sym("near", 2), ca.SX.sym("Q", 3)
    c = ca.SX.sym("c", FRICTION)
    body, mu, r, told, before = ca.vertsplit(
        c, [0, SIZE, SIZE + 1, SIZE + 2, FRICTION - 3, FRICTION]
    )
    on, held, moves, *weights = ca.vertsplit(told)
    _, normal = with_gradient()(u, body)
    along = unit_matrix(q) @ law.twist(v @ ca.DM(gauss(m).powers.sum(axis=0)))[1]
    shift = moves * own[1]
    pressure = (near[0], own[1], near[1])
    pressed = held * own[0] + sum(x * p for x, p in zip(weights, pressure, strict=True))
    w = Q - r * (u - before)
    w -= normal * ca.dot(normal, w)
    most, found = mu * ca.fmax(pressed, 0), ca.sqrt(ca.sumsqr(w) + _TINY)
    share = ca.if_else(found > most, most / found, 1)
    rows = [-shift * ca.cross(along, Q), -Q, Q - on * share * w]
    return Kernel(
        "contact_friction", ca.vertcat(ca.vec(v), q, u, own, near, Q), c, ca.vertcat(*rows)
    )
