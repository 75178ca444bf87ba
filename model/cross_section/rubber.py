"""Exact tendons on a neo-Hookean body of constant volume; see NeoHookean."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from model.cross_section.energy import EnergySection


@dataclass(frozen=True)
class RubberSection(EnergySection):
    """EA (l^2 + 2/l - 3) / 6 + EJ (1 + 2/l^3) / (6 l) kappa^2 + GI kappa_t^2 / (2 l), l = lambda.

    The section and its tendons' offsets shrink by l^(-1/2): c = nu + l^(-1/2) (y' d + y kappa x d).

    Attributes
    ----------
    anticlastic : bool
        Whether tendons shift with the section that swells on the inside of a bend.
    """

    anticlastic: bool = field(default=False, kw_only=True)

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJ, GI, GA = ca.vertsplit(body)
        stretch = nu[0]
        bend = EJ * ca.sumsqr(kappa[1:]) / 2 * (1 + 2 / stretch**3) / (3 * stretch)
        twist = GI * kappa[0] ** 2 / (2 * stretch)
        along = EA / 6 * (stretch**2 + 2 / stretch - 3)
        return along + bend + twist + GA * ca.sumsqr(nu[1:]) / 2

    def tangent(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tangent."""
        kappa, nu = self.twist(v)
        y, y_rate, cos, sin = ca.vertsplit(path)
        shrink = 1 / ca.sqrt(nu[0])
        d = ca.vertcat(0, cos, sin)
        c = nu + shrink * (y_rate * d + y * ca.cross(kappa, d))
        if self.anticlastic:
            inward, across = (
                y * (kappa[2] * cos - kappa[1] * sin),
                y * (kappa[2] * sin + kappa[1] * cos),
            )
            c[0] -= (inward**2 - across**2) / (4 * nu[0] ** 2)
        return c
