"""Statics from an energy without loads: exact tendons on a linear or a neo-Hookean body."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.statics.algebra import solve_symmetric
from model.statics.energy import SectionEnergy

_STEPS = 14


@dataclass(frozen=True)
class Exact(SectionEnergy):
    """A section settles where its energy is stationary; see ExactTendons and NeoHookean.

    Unknowns are v = (kappa_n, kappa_b, lambda) per unit reference length, lambda = 1 + q only with
    extension. Without loads kappa_t = 0: the energy is even in it.

    Attributes
    ----------
    settled : float
        A section has settled where the last step of Newton's method is below it, relative to v.
    """

    settled: float = 1e-9

    @property
    def names(self) -> tuple[str, ...]:
        """See Statics.names."""
        return ("xi", "k", "q") if self.extension else ("xi", "k")

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.solve: Newton's method from the solution for y' = 0."""
        newton = self._newton()
        v = self._guess(pull, data)
        for _ in range(_STEPS):
            v, step = newton(v, pull, data)
        return self.strain(ca.if_else(step < self.settled, v, np.nan))

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

    def _newton(self) -> ca.Function:
        """Return (v, pull, data) -> v after a Newton step, and the size of the step relative to v.

        The stretch never falls by more than half in a step.
        """
        pull, data = ca.SX.sym("pull", self.n_pull), ca.SX.sym("data", self.n_data)
        v, slope, hessian = self._symbols(pull, data)
        step = solve_symmetric(hessian, -slope)
        moved = v + step
        if self.extension:
            moved[2] = ca.fmax(moved[2], v[2] / 2)
        size = ca.norm_inf(step[:2]) / (1 + ca.norm_inf(v[:2]))
        if self.extension:
            size = ca.fmax(size, ca.fabs(step[2]))
        return ca.Function("newton", [v, pull, data], [moved, size], {"cse": True})

    def _guess(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        EA, EJ = data[0], data[1]
        total, m_n, m_b = ca.SX(0), ca.SX(0), ca.SX(0)
        for j, i in enumerate(self.section):
            total += pull[j]
            m_n -= pull[j] * data[3 + i] * self.sin[j]
            m_b += pull[j] * data[3 + i] * self.cos[j]
        if not self.extension:
            return ca.vertcat(m_n, m_b) / EJ
        if not self.rubber:
            return ca.vertcat(m_n / EJ, m_b / EJ, ca.fmax(1 - total / EA, 0.05))
        stretch = 1 / ca.sqrt(1 + 2 * total / EA)
        stiff = EJ * (1 + 2 / stretch**3) / (3 * ca.sqrt(stretch))
        return ca.vertcat(m_n / stiff, m_b / stiff, stretch)

    def strain(self, v: ca.SX) -> ca.SX:
        """See ClosedStatics.strain."""
        return ca.vertcat(v[:2] / v[2], v[2] - 1) if self.extension else v

    def unknowns(self, strain: ca.SX) -> ca.SX:
        """See ClosedStatics.unknowns: (kappa_n, kappa_b, lambda)."""
        if not self.extension:
            return strain
        return ca.vertcat(strain[:2] * (1 + strain[2]), 1 + strain[2])
