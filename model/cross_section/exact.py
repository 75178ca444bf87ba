"""Exact tendons on a linear body; see ExactTendons."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.cross_section.energy import EnergySection


@dataclass(frozen=True)
class ExactSection(EnergySection):
    """EA (lambda - 1)^2 / 2 + EJ (kappa_n^2 + kappa_b^2) / 2 + GI kappa_t^2 / 2, and shear.

    Tendons run along c = nu + y' d + y kappa x d.
    """

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJ, GI, GA = ca.vertsplit(body)
        bend = EJ * ca.sumsqr(kappa[1:]) + GI * kappa[0] ** 2
        return (EA * (nu[0] - 1) ** 2 + bend + GA * ca.sumsqr(nu[1:])) / 2
