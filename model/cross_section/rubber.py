"""Exact tendons on a neo-Hookean body of constant volume; see NeoHookean."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from model.cross_section.energy import EnergySection
from model.cross_section.law import offset


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

    def width(self, stretch: ca.SX) -> ca.SX:
        """See EnergySection.width: the volume is constant."""
        return 1 / ca.sqrt(stretch)

    def drawn(self, bend: ca.SX, nu: ca.SX, w: ca.SX, path: ca.SX) -> ca.SX:
        """See EnergySection.drawn."""
        c = super().drawn(bend, nu, w, path)
        if self.anticlastic:
            Y, _ = offset(path)
            inward = bend[2] * Y[1] - bend[1] * Y[2]
            across = bend[2] * Y[2] + bend[1] * Y[1]
            c[0] -= (inward**2 - across**2) / (4 * nu[0])
        return c
