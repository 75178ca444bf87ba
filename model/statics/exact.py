"""Statics from an energy without loads: exact tendons on a linear or a neo-Hookean body."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.statics.algebra import solve_symmetric
from model.statics.energy import TINY, SectionEnergy
from model.statics.section_newton import newton

# Ordinary tensions settle in 4 to 7 steps; a thousand times as much in 30.
_STEPS, _CAREFUL_STEPS = 10, 40


@dataclass(frozen=True)
class Exact(SectionEnergy):
    """A section settles where its energy is stationary; see ExactTendons and NeoHookean.

    Unknowns are v = (kappa_n, kappa_b, lambda) per unit reference length, lambda = 1 + q only with
    extension. Without loads kappa_t = 0: the energy is even in it.

    Attributes
    ----------
    careful : bool
        Whether to take more steps, for tensions far beyond the usual.
    settled : float
        A section has settled where the last step of Newton's method is below it, relative to v.
    """

    careful: bool = False
    settled: float = 1e-9

    @property
    def names(self) -> tuple[str, ...]:
        """See Statics.names."""
        return ("xi", "k", "q") if self.extension else ("xi", "k")

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.solve: a fixed number of steps; see model.statics.section_newton."""
        step = newton(self)
        u, w = self._straight(pull, data), ca.SX.zeros(1 + self.rubber, self.n_pull)
        for _ in range(_CAREFUL_STEPS if self.careful else _STEPS):
            u, w, size = step(u, w, pull, data)
        v = u if not self.rubber else ca.vertcat(u[:2] * ca.sqrt(u[2]), u[2])
        return self.strain(ca.if_else(size < self.settled, v, np.nan))

    def taut_body(self, u: ca.SX, data: ca.SX) -> ca.SX:
        """Return the energy of the body of taut strains u.

        Those of a neo-Hookean body are kappa lambda^(-1/2) and lambda, of which its tendons' length
        along the arm is linear; of a linear body they are v itself.
        """
        if not self.rubber:
            return self._body(u, data)
        return self._body(ca.vertcat(u[:2] * ca.sqrt(u[2]), u[2]), data)

    def taut_tangent(self, j: int, u: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return what of the tangent of tendon j depends on taut strains u, and |the rest|^2."""
        y, slope = data[3 + self.section[j]], data[3 + self.n_sections + self.section[j]]
        stretch = u[2] if self.extension else ca.SX(1)
        inward = y * (u[1] * self.cos[j] - u[0] * self.sin[j])
        along = stretch - inward
        if self.anticlastic:
            across = y * (u[1] * self.sin[j] + u[0] * self.cos[j])
            along -= (inward**2 - across**2) / (4 * stretch)
        if self.rubber:
            return ca.vertcat(along, slope / ca.sqrt(stretch)), ca.SX(TINY)
        return along, slope**2 + TINY

    def residual(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.residual: the gradient of the energy."""
        u, slope, _ = self._symbols(pull, data)
        return ca.substitute([slope], [u], [v])[0]

    def rate(
        self, strain: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX
    ) -> ca.SX:
        """See Statics.rate: the derivative along s of the energy's vanishing gradient."""
        v, slope, hessian = self._symbols(pull, data)
        along = ca.jtimes(slope, data, data_rate) + ca.jtimes(slope, pull, pull_rate)
        change = ca.substitute([solve_symmetric(hessian, -along)], [v], [self.unknowns(strain)])[0]
        if not self.extension:
            return change
        stretch = 1 + strain[2]
        turns = (change[:2] - strain[:2] * change[2]) / stretch
        return ca.vertcat(turns, change[2])

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, data: ca.SX) -> ca.SX:
        """See Statics.jump: without external load the section beyond settles by itself."""
        return self.solve(inner, data)

    def stretch(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See Statics.stretch."""
        return strain[2] if self.extension else ca.SX(0)

    def _symbols(self, pull: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return v, the energy's gradient and its Hessian in v."""
        v = ca.SX.sym("v", len(self.names))
        hessian, slope = ca.hessian(self(v, pull, data), v)
        return v, slope, hessian

    def _straight(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains to begin with: no curvature."""
        if not self.extension:
            return ca.SX.zeros(2)
        shortened = 1 / ca.sqrt(1 + 2 * ca.sum1(pull) / data[0]) if self.rubber else ca.SX(1)
        return ca.vertcat(0, 0, shortened)

    def strain(self, v: ca.SX) -> ca.SX:
        """See ClosedStatics.strain."""
        return ca.vertcat(v[:2] / v[2], v[2] - 1) if self.extension else v

    def unknowns(self, strain: ca.SX) -> ca.SX:
        """See ClosedStatics.unknowns: (kappa_n, kappa_b, lambda)."""
        if not self.extension:
            return strain
        return ca.vertcat(strain[:2] * (1 + strain[2]), 1 + strain[2])
