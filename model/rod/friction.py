"""Kernels with friction: tensions fall with the angle that a tendon has turned; see Friction.

    T(s) = T(0) exp(-direction mu Theta(s))        Theta' = |d(c/|c|)/ds| in the base frame

The turning of a tendon's tangent asks for the rates v' of the strains. They are unknowns of their
own at the stages, and the derivative of the law along s is their equation:

    d/ds (body(v) + sum T tendon(v)) = (-kappa x M - nu x F, -kappa x F - R^T f) in local components

Where other tendons end the strains jump, and what goes on is bent sharply, by the angle between its
tangents on both sides.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, body_size, size, turning_rate
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss, weighted_sum
from octoplan.model.rod.kernels import Kernel, Steps
from octoplan.model.rotations import norm


def body_rates(law: CrossSection) -> Kernel:
    """Return the kernel of the body and of its derivative along s.

    Strains, rates; body numbers, their rates -> wrench, wrench rate.
    """
    v, rate = ca.SX.sym("v", size(law)), ca.SX.sym("rate", size(law))
    n = body_size(law)
    numbers, change = ca.SX.sym("body", n), ca.SX.sym("change", n)
    wrench = law.body(v, numbers)
    along = ca.jtimes(wrench, v, rate) + ca.jtimes(wrench, numbers, change)
    rows = ca.vertcat(wrench, along)
    return Kernel("body_rates", ca.vertcat(v, rate), ca.vertcat(numbers, change), rows)


class TendonSymbols:
    """Unknowns and numbers of one tendon in one element of m stages, and its Theta' at these.

    Unknowns: load factor, tension at the motor, Theta at both nodes, strains and rates by stage.
    Numbers: h, direction times mu, and at the stages the offset along n, b and two derivatives.
    """

    def __init__(self, law: CrossSection, m: int) -> None:
        self.load, self.tension = ca.SX.sym("load"), ca.SX.sym("T")
        self.before, self.after = ca.SX.sym("before"), ca.SX.sym("after")
        z, Y = ca.SX.sym("z", 2 * size(law), m), ca.SX.sym("Y", 6, m)
        self.v, self.rate = z[: size(law), :], z[size(law) :, :]
        self.h, self.mu = ca.SX.sym("h"), ca.SX.sym("mu")
        self.paths, self.changes = ca.horzsplit(Y[:4, :]), ca.horzsplit(Y[2:, :])
        self.unknowns = ca.vertcat(self.load, self.tension, self.before, self.after, ca.vec(z))
        self.numbers = ca.vertcat(self.h, self.mu, ca.vec(Y))
        stages = zip(*map(ca.horzsplit, (self.v, self.rate)), self.paths, self.changes, strict=True)
        self.turning = [turning_rate(law, *stage) for stage in stages]


def sliding_tendon(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a tendon that slides through an element; see TendonSymbols.

    Rows: by stage its wrench and the derivative of that along s; the residual of Theta at the far
    node.
    """
    x, method, rows, through = TendonSymbols(law, m), gauss(m), [], Steps()
    turning = [through.name(each) for each in x.turning]
    for i in range(m):
        v, path = x.v[:, i], x.paths[i]
        turned = x.before + x.h * weighted_sum(method.a[i], turning)
        T = through.name(x.tension * ca.exp(-x.load * x.mu * turned))
        pull = law.tendon(v, path)
        along = ca.jtimes(pull, v, x.rate[:, i]) + ca.jtimes(pull, path, x.changes[i])
        pull = through.name(pull)
        falls = through.name(along - x.load * x.mu * turning[i] * pull)
        rows += [T * pull, T * falls]
    rows.append(x.after - x.before - x.h * weighted_sum(method.b, turning))
    return Kernel("sliding_tendon", x.unknowns, x.numbers, ca.vertcat(*rows), through)


def turning_function(law: CrossSection, m: int) -> ca.Function:
    """Return (unknowns, numbers) -> Theta' at the stages (m,); see TendonSymbols."""
    x = TendonSymbols(law, m)
    return ca.Function("turning", [x.unknowns, x.numbers], [ca.vertcat(*x.turning)])


def kink(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a tendon's kink between two elements: by how much Theta grows there.

    Unknowns: strains and rates by stage of the element before and of that beyond. Numbers: h of
    both, the tendon's path at the node. Strains at the node are those of the polynomials through
    strains and rates.
    """
    n = size(law)
    before, beyond = ca.SX.sym("before", 2 * n, m), ca.SX.sym("beyond", 2 * n, m)
    h, path = ca.SX.sym("h", 2), ca.SX.sym("path", 4)
    ends = ((before, h[0], 1.0), (beyond, h[1], 0.0))
    units = []
    for z, length, x in ends:
        value, slope = hermite(m, x)
        c = law.tangent(z[:n, :] @ ca.DM(value) + length * (z[n:, :] @ ca.DM(slope)), path)
        units.append(c / ca.norm_2(c))
    half = ca.fmin(norm(units[0] - units[1]) / 2, 1)
    y = ca.vertcat(ca.vec(before), ca.vec(beyond))
    return Kernel("kink", y, ca.vertcat(h, path), -2 * ca.asin(half))


def idle_tendon() -> Kernel:
    """Return the kernel of a tendon beyond its end: it turns no further there."""
    before, after = ca.SX.sym("before"), ca.SX.sym("after")
    return Kernel("idle_tendon", ca.vertcat(before, after), ca.SX(0, 1), after - before)


def hermite(m: int, x: float, derivative: int = 0) -> tuple[Array, Array]:
    """Return the weights (m,) of values and of slopes at the Gauss nodes for the value at x.

    Or for the derivative there.
    """
    c, p = gauss(m).c, np.arange(2 * m)
    values = c[:, None] ** p
    slopes = p * c[:, None] ** np.maximum(p - 1, 0)
    wanted = p * x ** np.maximum(p - 1, 0) if derivative else x**p
    weights = np.linalg.solve(np.vstack([values, slopes]).T, wanted)
    return weights[:m], weights[m:]
