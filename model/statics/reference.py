"""The paper's statics, made consistent: moment balance with the reference tangent."""

from __future__ import annotations

import casadi as ca


class ReferenceTangent:
    """Tendon tangent c = t + y' d + y omega x d, as the paper takes it; linear in omega.

    Moment balance of the part beyond the section, K omega = - sum T y d x c + M, becomes
    (K + sum T y2 (1 - d d^T)) omega = sum T y t x d + M: without loads tau = 0 and the curvatures
    are in closed form. Source: eqs. (3), (6), (8) of the paper with d and M as in its section 4;
    the differential form is the derivative of the balance, eq. (10) with omega x K omega added.
    """

    names: tuple[str, ...] = ("xi", "k")

    def __init__(self, extension: bool) -> None:
        self.extension = extension

    def _balance(self, pull: ca.SX, body: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return D and m in D omega - m = M."""
        _, c, s, cc, sc, ss = ca.vertsplit(pull)
        EJ = body[1]
        return ca.blockcat([[EJ + ss, -sc], [-sc, EJ + cc]]), ca.vertcat(-s, c)

    def solve(self, pull: ca.SX, body: ca.SX, moment: ca.SX) -> ca.SX:
        """See Statics.solve."""
        D, m = self._balance(pull, body)
        return solve_2x2(D, m + moment)

    def moment(self, strain: ca.SX, pull: ca.SX, body: ca.SX) -> ca.SX:
        """See Statics.moment."""
        D, m = self._balance(pull, body)
        return D @ strain - m

    def rate(
        self, strain: ca.SX, pull: ca.SX, body: ca.SX, pull_rate: ca.SX, body_rate: ca.SX
    ) -> ca.SX:
        """See Statics.rate: eq. (10) with the turning of the frame; the external moment is zero."""
        D, _ = self._balance(pull, body)
        D_rate, m_rate = self._balance(pull_rate, body_rate)
        return solve_2x2(D, m_rate - D_rate @ strain)

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, body: ca.SX) -> ca.SX:
        """See Statics.jump: the external moment is continuous."""
        return self.solve(inner, body, self.moment(strain, outer, body))

    def stretch(self, strain: ca.SX, pull: ca.SX, body: ca.SX) -> ca.SX:
        """See Statics.stretch."""
        return axial_strain(strain, pull, body) if self.extension else ca.SX(0)


def axial_strain(strain: ca.SX, pull: ca.SX, body: ca.SX) -> ca.SX:
    """Return q from E A q = - sum T t . c with the reference tangent, eqs. (3b), (9a)."""
    xi, k = strain[-2], strain[-1]
    return (k * pull[1] - xi * pull[2] - pull[0]) / body[0]


def solve_2x2(D: ca.SX, rhs: ca.SX) -> ca.SX:
    """Return D^-1 rhs for a positive definite 2x2 matrix."""
    det = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    first = (D[1, 1] * rhs[0] - D[0, 1] * rhs[1]) / det
    second = (D[0, 0] * rhs[1] - D[1, 0] * rhs[0]) / det
    return ca.vertcat(first, second)
