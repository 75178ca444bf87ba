"""The paper's statics, made consistent: moment balance with the reference tangent."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from model.arm import Arm
from model.paths import Array
from model.statics.sums import tendon_sums
from model.stations import Stations


@dataclass(frozen=True)
class SumsOverTendons:
    """What statics with the reference tangent take from a cross-section.

    `pull` are the six sums of model.statics.sums, `data` is E A, E J, G I.
    """

    extension: bool
    n_pull: int = field(default=6, init=False)
    n_data: int = field(default=3, init=False)

    def pulls(self, arm: Arm, at: Stations) -> tuple[Array, Array]:
        """See Statics.pulls."""
        return tendon_sums(arm, at)

    def data(self, at: Stations) -> tuple[Array, Array]:
        """See Statics.data."""
        return at.body, at.body_rate

    def stretch(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See Statics.stretch: E A q = - sum T t . c, reference tangent, eqs. (3b), (9a)."""
        if not self.extension:
            return ca.SX(0)
        xi, k = strain[-2], strain[-1]
        return (k * pull[1] - xi * pull[2] - pull[0]) / data[0]


@dataclass(frozen=True)
class ReferenceTangent(SumsOverTendons):
    """Tendon tangent c = t + y' d + y omega x d, as the paper takes it; linear in omega.

    Moment balance of the part beyond the section, K omega = - sum T y d x c + M, becomes
    (K + sum T y2 (1 - d d^T)) omega = sum T y t x d + M: without loads tau = 0 and the curvatures
    are in closed form. Source: eqs. (3), (6), (8) of the paper with d and M as in its section 4;
    the differential form is the derivative of the balance, eq. (10) with omega x K omega added.
    """

    names: tuple[str, ...] = field(default=("xi", "k"), init=False)

    def _balance(self, pull: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return D and m in D omega - m = M."""
        _, c, s, cc, sc, ss = ca.vertsplit(pull)
        EJ = data[1]
        return ca.blockcat([[EJ + ss, -sc], [-sc, EJ + cc]]), ca.vertcat(-s, c)

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.solve."""
        return solve_2x2(*self._balance(pull, data))

    def unknowns(self, strain: ca.SX) -> ca.SX:
        """See ClosedStatics.unknowns: the strains themselves."""
        return strain

    def residual(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.residual."""
        return self.moment(v, pull, data)

    def strain(self, v: ca.SX) -> ca.SX:
        """See ClosedStatics.strain."""
        return v

    def moment(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the external moment (2,) that balances body and tendons [N m]."""
        D, m = self._balance(pull, data)
        return D @ strain - m

    def rate(
        self, strain: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX
    ) -> ca.SX:
        """See Statics.rate: eq. (10) with the turning of the frame; the external moment is zero."""
        D, _ = self._balance(pull, data)
        D_rate, m_rate = self._balance(pull_rate, data_rate)
        return solve_2x2(D, m_rate - D_rate @ strain)

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, data: ca.SX) -> ca.SX:
        """See Statics.jump: the external moment is continuous."""
        D, m = self._balance(inner, data)
        return solve_2x2(D, m + self.moment(strain, outer, data))


def solve_2x2(D: ca.SX, rhs: ca.SX) -> ca.SX:
    """Return D^-1 rhs for a positive definite 2x2 matrix."""
    det = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    first = (D[1, 1] * rhs[0] - D[0, 1] * rhs[1]) / det
    second = (D[0, 0] * rhs[1] - D[1, 0] * rhs[0]) / det
    return ca.vertcat(first, second)
