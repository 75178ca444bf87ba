"""Laws with an energy: exact tendons, whose potential is tension times length, and a body."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from octoplan.model.cross_section.law import (
    STIFFNESS_SIZE,
    TINY,
    CrossSection,
    Name,
    elastic_strains,
    join,
    offset,
    size,
    split,
)


@dataclass(frozen=True)
class EnergySection(CrossSection):
    """Strains are kappa, lambda = 1 + q and shears, all per unit reference length.

    The wrench is the gradient of `energy` plus the gradient of the sum of T |c|; see CrossSection.
    A subclass defines the energy, and the width of the section as a function of the stretch.
    """

    along_at_rest: ClassVar[float] = 1.0

    @abstractmethod
    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """Return the energy of a body that is straight at rest, per unit reference length [N]."""

    def width(self, stretch: ca.SX) -> ca.SX:
        """Return the width of a section relative to rest: 1 for a rigid section."""
        return ca.SX(1)

    def tangent(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tangent: c = nu + w (Y' + kappa x Y) with the width w."""
        kappa, nu = self.twist(v)
        w = self.width(nu[0])
        return self.tangent_of_bend(w * kappa, nu, w, path)

    def tangent_of_bend(self, bend: ca.SX, nu: ca.SX, w: ca.SX, path: ca.SX) -> ca.SX:
        """Return the tangent of a tendon, a linear function of bend = w kappa (3,)."""
        Y, Y_rate = offset(path)
        return nu + w * Y_rate + ca.cross(bend, Y)

    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See CrossSection.twist."""
        kappa, stretch, slide = split(self, v)
        along = stretch if self.extension else ca.SX(1)
        return kappa, ca.vertcat(along, slide)

    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See CrossSection.strains."""
        return join(self, kappa, nu[0], nu[1:])

    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See CrossSection.body: the gradient of the energy."""
        at = ca.SX.sym("v", size(self))
        gradient = ca.gradient(self.energy(at, body[:STIFFNESS_SIZE]), at)
        return ca.substitute([gradient], [at], [elastic_strains(self, v, body)])[0]

    def tendon(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tendon: the gradient of |c(v, w(v))|, (c_v + c_w w_v)^T c / |c|."""
        at = ca.SX.sym("v", size(self))
        w = ca.SX.sym("w")
        kappa, nu = self.twist(at)
        width = self.width(nu[0])
        c = self.tangent_of_bend(w * kappa, nu, w, path)
        jacobian = ca.jacobian(c, at) + ca.jacobian(c, w) @ ca.jacobian(width, at)
        here = [v, name(ca.substitute(width, at, v))]
        tangent, jacobian = (ca.substitute([f], [at, w], here)[0] for f in (c, jacobian))
        tangent = name(tangent)
        return jacobian.T @ (tangent / ca.sqrt(ca.sumsqr(tangent) + TINY))


@dataclass(frozen=True)
class ExactSection(EnergySection):
    """EA (lambda - 1)^2 / 2 + EJ (kappa_n^2 + kappa_b^2) / 2 + GI kappa_t^2 / 2, and shear.

    Tendons run along c = nu + y' d + y kappa x d.
    """

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJn, EJb, GI, GA = ca.vertsplit(body)
        bend = EJn * kappa[1] ** 2 + EJb * kappa[2] ** 2 + GI * kappa[0] ** 2
        return (EA * (nu[0] - 1) ** 2 + bend + GA * ca.sumsqr(nu[1:])) / 2


@dataclass(frozen=True)
class RubberSection(EnergySection):
    """EA (l^2 + 2/l - 3) / 6 + EJ (1 + 2/l^3) / (6 l) kappa^2 + GI kappa_t^2 / (2 l), l = lambda.

    The section and the offsets of tendons shrink by l^(-1/2): c = nu + l^(-1/2) (y' d + y kappa x
    d).

    Attributes
    ----------
    anticlastic : bool
        Whether tendons shift with the section, which swells on the inside of a bend.
    """

    anticlastic: bool = field(default=False, kw_only=True)

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJn, EJb, GI, GA = ca.vertsplit(body)
        stretch = nu[0]
        bend = (EJn * kappa[1] ** 2 + EJb * kappa[2] ** 2) / 2
        bend *= (1 + 2 / stretch**3) / (3 * stretch)
        twist = GI * kappa[0] ** 2 / (2 * stretch)
        along = EA / 6 * (stretch**2 + 2 / stretch - 3)
        return along + bend + twist + GA * ca.sumsqr(nu[1:]) / 2

    def width(self, stretch: ca.SX) -> ca.SX:
        """See EnergySection.width: the volume is constant."""
        return 1 / ca.sqrt(stretch)

    def tangent_of_bend(self, bend: ca.SX, nu: ca.SX, w: ca.SX, path: ca.SX) -> ca.SX:
        """See EnergySection.tangent_of_bend."""
        c = super().tangent_of_bend(bend, nu, w, path)
        if self.anticlastic:
            Y, _ = offset(path)
            inward = bend[2] * Y[1] - bend[1] * Y[2]
            across = bend[2] * Y[2] + bend[1] * Y[1]
            c[0] -= (inward**2 - across**2) / (4 * nu[0])
        return c
