"""Where the energy of a section is least: Newton's method that holds at any tension.

A tendon's energy T |c| is nearly straight in the strains, but for a kink where the tendon has no
length left, and plain steps jump to and fro across it. So each tendon carries the unit vector
w = c / |c| as an unknown of its own, in the manner of Chan, Golub and Mulet (A nonlinear
primal-dual method for total variation-based image restoration, SIAM J. Sci. Comput. 20, 1999): the
equations are then nearly linear, and w stays in the unit ball. Beginning at w = 0, the first step
is the closed form of the paper's tangent, whose curvature never passes 1/y either.
"""

from __future__ import annotations

from typing import Protocol

import casadi as ca

from model.statics.algebra import solve_symmetric

# Of a neo-Hookean body at rest, the least stiffness that a step is taken with: the energy is not
# convex everywhere. That of a linear body is, and at least as stiff as without tendons.
_LEAST = 0.1
# What of its stretch a step may take from a neo-Hookean body, add to it, and bend it by (curvature
# times radius): 4 to 7 steps do where an arm curls up, 30 at a thousand times that tension.
_SHRINKS, _GROWS, _BENDS = 0.3, 2.0, 1.0
_TINY = 1e-300


class Section(Protocol):
    """What the method asks of a section's energy; see Exact. Strains are taut ones, u."""

    @property
    def rubber(self) -> bool:
        """See SectionEnergy."""

    @property
    def extension(self) -> bool:
        """See SectionEnergy."""

    @property
    def section(self) -> tuple[int, ...]:
        """See SectionEnergy."""

    @property
    def n_pull(self) -> int:
        """See SectionEnergy."""

    @property
    def n_data(self) -> int:
        """See SectionEnergy."""

    def taut_body(self, u: ca.SX, data: ca.SX) -> ca.SX:
        """Return the energy of the body."""

    def taut_tangent(self, j: int, u: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return what of the tangent of tendon j depends on u, and the square of the rest."""


def newton(section: Section) -> ca.Function:
    """Return (u, w, pull, data) -> u and w after a step, and its size.

    w (1 or 2, n_pull) are the tendons' unit vectors; the size counts curvatures by the radius.
    """
    n, rows = 2 + section.extension, 1 + section.rubber
    u, w = ca.SX.sym("u", n), ca.SX.sym("w", rows, section.n_pull)
    pull, data = ca.SX.sym("pull", section.n_pull), ca.SX.sym("data", section.n_data)
    hessian, slope = ca.hessian(section.taut_body(u, data), u)
    tendons = [_Tendon(*section.taut_tangent(j, u, data), u, w[:, j]) for j in range(w.shape[1])]
    for j, tendon in enumerate(tendons):
        slope += pull[j] * tendon.slope
        hessian += pull[j] * tendon.curvature
    stiff = ca.vertcat(data[1], data[1], data[0])[:n] * (_LEAST if section.rubber else 1.0)
    step = solve_symmetric(hessian, -slope, stiff)
    radius = 2 * ca.sqrt(data[1] / data[0])
    size = radius * ca.norm_inf(step[:2]) / (1 + radius * ca.norm_inf(u[:2]))
    if section.extension:
        size = ca.fmax(size, ca.fabs(step[2]))
    if section.rubber:
        change = ca.fmax(-step[2] / _SHRINKS, step[2] / _GROWS)
        change = ca.fmax(change, radius * ca.norm_inf(step[:2]) / _BENDS)
        step = step / ca.fmax(1, change / u[2])
    turned = ca.horzcat(*(tendon.turned(step) for tendon in tendons))
    return ca.Function("newton", [u, w, pull, data], [u + step, turned, size], {"cse": True})


class _Tendon:
    """A tendon of 1 N: its tangent c at u, and what Newton's method needs of |c|."""

    def __init__(self, c: ca.SX, rest: ca.SX, u: ca.SX, w: ca.SX) -> None:
        self.c, self.w, self.length = c, w, ca.sqrt(ca.sumsqr(c) + rest)
        self.unit, self.along = c / self.length, ca.jacobian(c, u)
        self.slope = self.along.T @ self.unit
        across = ca.SX.eye(c.numel()) - (w @ self.unit.T + self.unit @ w.T) / 2
        held = ca.SX.sym("w", c.numel())
        bent = ca.substitute(ca.jacobian(self.along.T @ held, u), held, w)
        self.curvature = self.along.T @ (across / self.length) @ self.along + bent

    def turned(self, step: ca.SX) -> ca.SX:
        """Return w after a step of the strains, within the unit ball."""
        moved = self.along @ step
        w = (self.c + moved - self.w * ca.dot(self.unit, moved)) / self.length
        size = ca.fabs(w) if w.numel() == 1 else ca.sqrt(ca.sumsqr(w) + _TINY)
        return w / ca.fmax(1, size)
