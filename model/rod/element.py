"""The kernels: one element, one cross-section, one tendon in it, the clamp and the tip.

Between two nodes of the mesh, with kappa_i, nu_i the strains at the Gauss stages and a, b, c the
tableau (octoplan.model.rod.collocation), the tip-to-base equations are

    R_i = R_k exp(rotation to stage i)                 R_{k+1} = R_k exp(rotation across)
    u_{k+1} = u_k + h sum_j b_j R_j nu_j               (u' = nu, eq. (1))
    F_k = F_{k+1} + h sum_j b_j f_j                    (F' = -f)
    M_k = M_{k+1} + h sum_j b_j (R_j nu_j) x F_j       (M' = -u' x F, eq. (3))
    body(v_i) + sum T tendon(v_i) = (R_i^T M_i, R_i^T F_i)

with F_i, M_i at the stages by b_j - a_ij in place of b_j. Poses are known at the base, forces and
moments at the tip. Dead loads enter by their resultant beyond each stage, whose integral is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from octoplan.model.cross_section.law import CrossSection, body_size, join, size
from octoplan.model.rod.collocation import gauss, rotation_vectors, weighted_sum
from octoplan.model.rod.kernels import Kernel, Steps
from octoplan.model.rotations import half_angle, multiply, norm, unit_matrix


@dataclass(frozen=True)
class Form:
    """What the kernels depend on besides numbers.

    Attributes
    ----------
    law : CrossSection
    stages : int
        Of each element.
    loaded : bool
        Whether forces and moments act on the arm, so that moments are unknowns at the nodes.
    current : bool
        Whether a stream does.
    follower : bool
        Whether what acts on the tip follows it.
    friction : bool
        Whether tensions fall along the tendons.
    machine_code : bool
        Whether the kernels are compiled.
    contacts : int
        How many obstacles a node may touch.
    pressed : bool
        Whether the arm may lie on them, pressed between the nodes too.
    contact_friction : bool
        Whether there is friction between arm and obstacles.
    """

    law: CrossSection
    stages: int
    loaded: bool = True
    current: bool = False
    follower: bool = False
    friction: bool = False
    machine_code: bool = False
    contacts: int = 0
    pressed: bool = False
    contact_friction: bool = False

    @cached_property
    def moving(self) -> bool:
        """Whether some of the force depends on the shape, so that it is unknown at the nodes."""
        return self.current or self.follower or self.contacts > 0

    @cached_property
    def wrench(self) -> int:
        """Size of the forces and moments at a node."""
        return 3 * self.loaded + 3 * self.moving

    @cached_property
    def strains(self) -> int:
        """Number of strains of a cross-section."""
        return size(self.law)


class ElementSymbols:
    """Unknowns and numbers of one element.

    Unknowns: load factor, (q, M, F) at both nodes, u at both, strains at the stages. Numbers: h,
    a dead force (3,) and a moment (3,) beyond the last node that are no part of the loads, then by
    stage the dead resultant (3,), and with a current its drag, and once its velocity (3,); with
    friction the dead load per length (3,) by stage.
    """

    def __init__(self, form: Form) -> None:
        m, n = form.stages, form.strains
        self.load = ca.SX.sym("load", int(form.loaded))
        self.q, self.q_next = ca.SX.sym("q", 4), ca.SX.sym("q_next", 4)
        self.u, self.u_next = ca.SX.sym("u", 3), ca.SX.sym("u_next", 3)
        self.w, self.w_next = ca.SX.sym("w", form.wrench), ca.SX.sym("w_next", form.wrench)
        z = ca.SX.sym("v", n * (1 + form.friction), m)
        self.v = z[:n, :]
        parts = (self.load, self.q, self.u, self.w, ca.vec(z))
        self.unknowns = ca.vertcat(*parts, self.q_next, self.u_next, self.w_next)
        self.h = ca.SX.sym("h")
        self.force, self.moment = (ca.SX.sym(name, 3 * form.loaded) for name in ("force", "moment"))
        self.dead = ca.SX.sym("dead", 3 * form.loaded, m)
        self.drag = ca.SX.sym("drag", m * form.current)
        self.velocity = ca.SX.sym("velocity", 3 * form.current)
        self.spread = ca.SX.sym("spread", 3 * form.friction, m)
        loads = (self.force, self.moment, ca.vec(self.dead), self.drag, self.velocity)
        self.numbers = ca.vertcat(self.h, *loads, ca.vec(self.spread))


def element(form: Form) -> Kernel:
    """Return the kernel of an element.

    Rows: the residuals of M_k and F_k, less the local wrench at the stages (with friction each
    followed by its derivative along s), the residuals of q_{k+1} and u_{k+1}. All but the rows at
    the nodes is worked out in the frame at the first node.
    """
    x, law, method, through = ElementSymbols(form), form.law, gauss(form.stages), Steps()
    twists = [law.twist(v) for v in ca.horzsplit(x.v)]
    twists = [(through.name(kappa), nu) for kappa, nu in twists]
    *turns, across = turned(through, [kappa for kappa, _ in twists], x.h)
    R = [unit_matrix(turn) for turn in turns]
    along = [through.name(frame @ nu) for frame, (_, nu) in zip(R, twists, strict=True)]
    first = unit_matrix(x.q)
    rows = [
        x.q_next - multiply(x.q, across),
        x.u_next - x.u - x.h * first @ through.name(weighted_sum(method.b, along)),
    ]
    if form.loaded:
        F, f, at_node = _forces(x, form, through, [frame[:, 0] for frame in R], twists)
        levers = [through.name(ca.cross(t, f)) for t, f in zip(along, F, strict=True)]
        beyond = x.w_next[:3] + x.moment
        lever = through.name(weighted_sum(method.b, levers))
        at_node.insert(0, x.w[:3] - beyond - x.h * first @ lever)
        local = through.name(first.T @ beyond)
        M = [through.name(local + x.h * weighted_sum(method.b - row, levers)) for row in method.a]
        wrenches = [(frame.T @ m, frame.T @ f) for frame, m, f in zip(R, M, F, strict=True)]
        stages = [-join(law, m, force[0], force[1:]) for m, force in wrenches]
        if form.friction:
            spread = [frame.T @ load for frame, load in zip(R, f, strict=True)]
            rates = [_rate(law, *part) for part in zip(twists, wrenches, spread, strict=True)]
            stages = [row for pair in zip(stages, rates, strict=True) for row in pair]
        rows = [*at_node, *stages, *rows]
    else:
        rows = [ca.SX.zeros(x.v.numel()), *rows]
    return Kernel("element", x.unknowns, x.numbers, ca.vertcat(*rows), through)


def turned(through: Steps, kappa: list[ca.SX], h: ca.SX) -> list[ca.SX]:
    """Return the quaternions (4,) from the first node's frame to each stage's, and the last's."""
    within = Steps()
    stacked = ca.vertcat(*rotation_vectors(kappa, h, within.name))
    vectors = ca.vertsplit(through.name(stacked, within), 3)
    halves = [half_angle(through.name(ca.sumsqr(turn))) for turn in vectors]
    pairs = zip(halves, vectors, strict=True)
    return [through.name(ca.vertcat(half[0], half[1] * turn)) for half, turn in pairs]


def _forces(
    x: ElementSymbols,
    form: Form,
    through: Steps,
    t: list[ca.SX],
    twists: list[tuple[ca.SX, ca.SX]],
) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
    """Return the forces beyond each stage, the loads per length there, the residual of F_k.

    The former in the frame at the first node, in which t are the sections' normals.
    """
    method, first = gauss(form.stages), unit_matrix(x.q)
    F = [x.load * dead + x.force for dead in ca.horzsplit(x.dead)]
    beyond = x.w_next[3:] if form.moving else ca.SX.zeros(3)
    F = [through.name(first.T @ (dead + beyond)) for dead in F]
    f = [ca.SX.zeros(3)] * form.stages
    if form.current:
        velocity = through.name(first.T @ x.velocity)
        drags = zip(t, twists, ca.vertsplit(x.drag), strict=True)
        f = [through.name(x.load * drag_force(n, nu, drag, velocity)) for n, (_, nu), drag in drags]
    total = f
    if form.friction:
        spread = [first.T @ (x.load * load) for load in ca.horzsplit(x.spread)]
        total = [through.name(a + b) for a, b in zip(f, spread, strict=True)]
    if not form.moving:
        return F, total, []
    F = [
        through.name(dead + x.h * weighted_sum(method.b - row, f))
        for dead, row in zip(F, method.a, strict=True)
    ]
    return F, total, [x.w[3:] - beyond - x.h * first @ weighted_sum(method.b, f)]


def _rate(
    law: CrossSection, twist: tuple[ca.SX, ca.SX], local: tuple[ca.SX, ca.SX], load: ca.SX
) -> ca.SX:
    """Return less the derivative along s of the local wrench."""
    (kappa, nu), (moment, force) = twist, local
    pull = ca.cross(kappa, force) + load
    return join(law, ca.cross(kappa, moment) + ca.cross(nu, force), pull[0], pull[1:])


def drag_force(t: ca.SX, nu: ca.SX, drag: ca.SX, velocity: ca.SX) -> ca.SX:
    """Return the drag per unit reference length (3,) [N/m] in the frame of t; see Current."""
    across = velocity - t * ca.dot(t, velocity)
    return drag * nu[0] * norm(across) * across


def body(law: CrossSection) -> Kernel:
    """Return the kernel of the body of a cross-section: strains; numbers of it -> wrench."""
    v, numbers = ca.SX.sym("v", size(law)), ca.SX.sym("body", body_size(law))
    return Kernel("body", v, numbers, law.body(v, numbers))


def tendon(law: CrossSection) -> Kernel:
    """Return the kernel of a tendon in a cross-section: tension, strains; its path -> wrench."""
    T, v, path = ca.SX.sym("T"), ca.SX.sym("v", size(law)), ca.SX.sym("path", 4)
    through = Steps()
    wrench = T * law.tendon(v, path, through.name)
    return Kernel("tendon", ca.vertcat(T, v), path, wrench, through)


def run(law: CrossSection) -> Kernel:
    """Return the kernel of a tendon's length: strains; its path, a weight -> weight |u_c'|."""
    v, numbers = ca.SX.sym("v", size(law)), ca.SX.sym("numbers", 5)
    length = ca.norm_2(law.run(v, numbers[:4]))
    return Kernel("run", v, numbers, numbers[4] * length)


def clamp() -> Kernel:
    """Return the kernel of the base: pose there; that of the clamp -> their difference."""
    g, clamped = ca.SX.sym("g", 7), ca.SX.sym("clamped", 7)
    return Kernel("clamp", g, clamped, g - clamped)


def at_zero() -> Kernel:
    """Return the kernel of an unknown that is 0: a tendon's turning at its motor, or no contact."""
    value = ca.SX.sym("value")
    return Kernel("at_zero", value, ca.SX(0, 1), value)


def lever() -> Kernel:
    """Return the kernel of a force off the midline: load factor, q -> less its moment.

    Numbers: offset in the local frame (3,), force (3,). The moment at its node is that on the base
    side: M(s-) = M(s+) + (R o) x F.
    """
    load, q = ca.SX.sym("load"), ca.SX.sym("q", 4)
    offset, force = ca.SX.sym("offset", 3), ca.SX.sym("force", 3)
    moment = load * ca.cross(unit_matrix(q) @ offset, force)
    return Kernel("lever", ca.vertcat(load, q), ca.vertcat(offset, force), -moment)


def tip(form: Form) -> Kernel:
    """Return the kernel of the tip: load factor, q, M, F there -> the residuals of M and F.

    Numbers: moment and force (6,) of the loads, and a further moment (3,) that is no part of them.
    Dead forces are part of the elements' resultants.
    """
    load, q, w = ca.SX.sym("load"), ca.SX.sym("q", 4), ca.SX.sym("w", form.wrench)
    moment, force, further = (ca.SX.sym(name, 3) for name in ("moment", "force", "further"))
    turned = [unit_matrix(q) @ part if form.follower else part for part in (moment, force)]
    rows = [w[:3] - load * turned[0] - further]
    if form.moving:
        rows.append(w[3:] - load * turned[1] * int(form.follower))
    numbers = ca.vertcat(moment, force, further)
    return Kernel("tip", ca.vertcat(load, q, w), numbers, ca.vertcat(*rows))
