"""The paper's balance with the reference tangent, made consistent: no energy, but linear in T."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from model.cross_section.law import CrossSection, Name, join, less_rest, offset, split


@dataclass(frozen=True)
class PaperSection(CrossSection):
    """Eqs. (8), (9) with (6): strains omega per unit deformed length, q, and shears.

    K omega + sum T Y x c = M, E A q + sum T t . c = F_t, and with shear k_s G A nu_n + sum T n . c
    = F_n, along the tangent c = t + Y' + omega x Y with Y = y d. But for shears, and tendons that
    turn, this is linear in six resultants of the tendons' tensions. See CrossSection.
    """

    along_at_rest: ClassVar[float] = 0.0

    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See CrossSection.twist: kappa = (1 + q) omega, eq. (1)."""
        omega, q, slide = split(self, v)
        return (1 + q) * omega, ca.vertcat(1 + q, slide)

    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See CrossSection.strains."""
        return join(self, kappa / nu[0], nu[0] - 1, nu[1:])

    def reported(self, v: ca.SX) -> ca.SX:
        """See CrossSection.reported: the strains themselves."""
        return ca.vertcat(*split(self, v)[:2])

    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See CrossSection.body."""
        omega, q, slide = split(self, less_rest(self, v, body))
        EA, EJ, GI, GA = ca.vertsplit(body[:4])
        return join(self, ca.vertcat(GI, EJ, EJ) * omega, EA * q, GA * slide)

    def tendon(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tendon."""
        moment, along = self.tendons(v, ca.vertcat(*resultants(path[0], path[1])))
        moment += ca.cross(*offset(path))
        return join(self, moment, along, self.tangent(v, path)[1:])

    def tendons(self, v: ca.SX, sums: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the moment (3,) and the force along t of tendons with given resultants (6,)."""
        tau, xi, k = ca.vertsplit(split(self, v)[0])
        T, c, s, cc, sc, ss = ca.vertsplit(sums)
        moment = ca.vertcat((cc + ss) * tau, ss * xi - sc * k + s, cc * k - sc * xi - c)
        return moment, T + s * xi - c * k

    def tangent(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tangent: c = t + Y' + omega x Y."""
        Y, Y_rate = offset(path)
        return ca.SX([1, 0, 0]) + Y_rate + ca.cross(split(self, v)[0], Y)

    def run(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.run: u_c' of eq. (6), which is not quite the tangent of the balance."""
        kappa, nu = self.twist(v)
        Y, Y_rate = offset(path)
        return nu + Y_rate + ca.cross(kappa, Y)


def resultants(n: Any, b: Any) -> tuple[Any, ...]:
    """Return a tendon's share per newton in the resultants T, T Y, T Y Y^T (6), where Y = (n, b).

    Of the paper's four tendons a section they are the sums T1+T2+T3+T4, y (T1-T3), y (T2-T4),
    y2 (T1+T3), 0, y2 (T2+T4).
    """
    return 1.0, n, b, n * n, n * b, b * b
