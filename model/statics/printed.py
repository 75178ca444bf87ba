"""The paper's equations (10) and (11) to the letter."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from model.statics.reference import SumsOverTendons


@dataclass(frozen=True)
class Printed(SumsOverTendons):
    """Eq. (10) as printed, (K omega)' = M-dot without omega x K omega, and the jump of eq. (11).

    Torsion appears because the frame's turning is left out, so tau is a state.
    """

    names: tuple[str, ...] = field(default=("tau", "xi", "k"), init=False)

    def rate(
        self, strain: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX
    ) -> ca.SX:
        """See Statics.rate: eq. (10)."""
        tau, xi, k = ca.vertsplit(strain)
        _, c, s, cc, _, ss = ca.vertsplit(pull)
        _, c_rate, s_rate, cc_rate, _, ss_rate = ca.vertsplit(pull_rate)
        EJ, GI = data[1], data[2]
        EJ_rate, GI_rate = data_rate[1], data_rate[2]
        twist = -tau * (GI_rate + cc_rate + ss_rate) - k * xi * (cc - ss) + k * s + xi * c
        about_n = -xi * (EJ_rate + ss_rate) - tau * k * ss - tau * c - s_rate
        about_b = -k * (EJ_rate + cc_rate) + tau * xi * cc - tau * s + c_rate
        return ca.vertcat(twist / (GI + cc + ss), about_n / (EJ + ss), about_b / (EJ + cc))

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, data: ca.SX) -> ca.SX:
        """See Statics.jump: eq. (11), whatever other tendons cross the section."""
        own = inner - outer
        xi = -own[2] / (own[5] + data[1])
        k = own[1] / (own[3] + data[1])
        return strain + ca.vertcat(0, xi, k)
