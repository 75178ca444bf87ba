"""One step of an explicit Runge-Kutta scheme across an element, in symbols.

See model.equilibrium.integration for the equations, and for the numbers that they take.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.cross_section.law import join, size
from model.integrators.runge_kutta import RK8
from model.machine.buffered import Mapped
from model.obstacles.base import SIZE, with_gradient
from model.rotations import multiply, unit_matrix
from model.transcription.element import Form
from model.transcription.layout import POSE

SCHEME = RK8
# Under the root of a stream's speed, which may vanish.
_TINY = 1e-30


class Symbols:
    """Numbers of an element: once, then by node of the scheme; see _Part."""

    def __init__(self, form: Form, n_tendons: int) -> None:
        n, t, K = size(form.law), n_tendons, form.contacts * form.pressed
        self.h, self.load = ca.SX.sym("h"), ca.SX.sym("load")
        self.velocity = ca.SX.sym("velocity", 3 * form.current)
        self.T, self.mu = ca.SX.sym("T", t), ca.SX.sym("mu", t)
        self.bodies = ca.SX.sym("bodies", SIZE, K)
        self.at = [Node(n, form.current, t, K) for _ in SCHEME.samples]
        once = (self.h, self.load, self.velocity, self.T, self.mu, ca.vec(self.bodies))
        self.all = ca.vertcat(*once, *(node.all for node in self.at))


class Node:
    """Numbers of an element at a node of the scheme.

    Strains about which the law is linearised, the wrench there, how strains follow the wrench, dead
    loads beyond, drag; with friction the tendons' wrenches per newton, tensions, turning and its
    derivatives; what presses and rubs.
    """

    def __init__(self, n: int, current: bool, t: int, K: int) -> None:
        self.v, self.wrench = ca.SX.sym("v", n), ca.SX.sym("wrench", n)
        self.inverse = ca.SX.sym("inverse", n, n)
        self.dead, self.drag = ca.SX.sym("dead", 3), ca.SX.sym("drag", int(current))
        self.unit, self.pulls = ca.SX.sym("unit", n, t), ca.SX.sym("pulls", t)
        self.turning, self.slope = ca.SX.sym("turning", t), ca.SX.sym("slope", n, t)
        self.pressure = ca.SX.sym("pressure", K)
        self.traction = ca.SX.sym("traction", 3 * (K > 0))
        self.all = ca.vertcat(*(ca.vec(part) for part in vars(self).values()))


@lru_cache(maxsize=32)
def integrated_step(form: Form, n_tendons: int) -> Mapped:
    """Return (a node's unknowns, numbers) -> these after a step, the strains at SCHEME's nodes."""
    numbers = Symbols(form, n_tendons)
    y = ca.SX.sym("y", POSE + form.wrench + n_tendons)
    found: dict[float, ca.SX] = {}

    def rate(i: int, inner: ca.SX) -> ca.SX:
        c = SCHEME.nodes[i]
        along, v = _rate(form, numbers, numbers.at[SCHEME.samples.index(c)], inner)
        found[c] = v  # the last stage at a node is the most accurate
        return along

    after = SCHEME.step(rate, y, numbers.h)
    strains = ca.vertcat(*(found[c] for c in SCHEME.samples))
    step = ca.Function("integrated", [y, numbers.all], [after, strains], {"cse": True})
    return Mapped(step, form.machine_code)


def _rate(form: Form, numbers: Symbols, node: Node, y: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return y' and the strains."""
    q, u = y[:4], y[4:POSE]
    M = y[POSE : POSE + 3] if form.loaded else ca.SX.zeros(3)
    frame, F, w = unit_matrix(q), numbers.load * node.dead, POSE + form.wrench
    F = F + y[POSE + 3 : w] if form.moving else F
    local = frame.T @ F
    lack = join(form.law, frame.T @ M, local[0], local[1:]) - node.wrench
    if form.friction:
        pulls = numbers.T * ca.exp(-numbers.load * numbers.mu * y[w:])
        lack -= node.unit @ (pulls - node.pulls)
    v = node.v + node.inverse @ lack
    kappa, nu = form.law.twist(v)
    along = frame @ nu
    rates = [multiply(q, ca.vertcat(0, kappa)) / 2, along]
    if form.loaded:
        rates.append(-ca.cross(along, F))
    if form.moving:
        rates.append(-_pushed(form, numbers, node, u, frame, nu))
    return ca.vertcat(*rates, node.turning + node.slope.T @ (v - node.v)), v


def _pushed(form: Form, numbers: Symbols, node: Node, u: ca.SX, frame: ca.SX, nu: ca.SX) -> ca.SX:
    """Return the force per reference length that depends on the shape (3,) [N/m]."""
    found, t = ca.SX.zeros(3), frame[:, 0]
    if form.current:
        across = numbers.velocity - t * ca.dot(t, numbers.velocity)
        speed = ca.sqrt(ca.sumsqr(across) + _TINY)
        found += numbers.load * node.drag * nu[0] * speed * across
    for k in range(node.pressure.numel()):
        found += node.pressure[k] * with_gradient()(u, numbers.bodies[:, k])[1]
    return found + frame @ node.traction if node.pressure.numel() else found
