"""Laws from an energy: exact tendons, whose potential is tension times length, on a body."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from model.cross_section.law import TINY, join, offset, size, split


@dataclass(frozen=True)
class EnergySection:
    """Strains are kappa, lambda = 1 + q and shears, all per unit reference length.

    The wrench is the gradient of `energy` plus that of the sum of T |c|; see CrossSection. A law of
    this kind states its energy, and what its section and tendons do as it stretches.
    """

    extension: bool
    torsion: bool = True
    shear: bool = False
    along_at_rest: float = field(default=1.0, init=False)

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """Return the energy of the body per unit reference length [N]."""
        raise NotImplementedError

    def width(self, stretch: ca.SX) -> ca.SX:
        """Return the width of a section over that at rest: 1, if it is rigid."""
        return ca.SX(1)

    def tangent(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tangent: c = nu + w (Y' + kappa x Y) of a section of width w."""
        kappa, nu = self.twist(v)
        return self.drawn(self.width(nu[0]) * kappa, nu, path)

    def drawn(self, bend: ca.SX, nu: ca.SX, path: ca.SX) -> ca.SX:
        """Return the tangent of a tendon from bend = w kappa (3,), in which it is linear."""
        Y, Y_rate = offset(path)
        return nu + self.width(nu[0]) * Y_rate + ca.cross(bend, Y)

    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See CrossSection.twist."""
        kappa, stretch, slide = split(self, v)
        return kappa, ca.vertcat(stretch if self.extension else ca.SX(1), slide)

    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See CrossSection.strains."""
        return join(self, kappa, nu[0], nu[1:])

    def reported(self, v: ca.SX) -> ca.SX:
        """See CrossSection.reported."""
        kappa, nu = self.twist(v)
        return ca.vertcat(kappa / nu[0], nu[0] - 1)

    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See CrossSection.body: the gradient of the energy."""
        at = ca.SX.sym("v", size(self))
        return ca.substitute([ca.gradient(self.energy(at, body), at)], [at], [v])[0]

    def tendon(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tendon: the gradient of |c|."""
        at = ca.SX.sym("v", size(self))
        length = ca.sqrt(ca.sumsqr(self.tangent(at, path)) + TINY)
        return ca.substitute([ca.gradient(length, at)], [at], [v])[0]

    def run(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.run: the tangent."""
        return self.tangent(v, path)
