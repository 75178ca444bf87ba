"""The tip-to-base equations of a loaded arm: SX expressions of states (model.loaded.state).

With F and M the loads beyond s, kappa and nu the strains per unit reference length, and L the
wrench that strains and tendons balance,

    F' = -f        M' = -u' x F        L(strain; T, s) = (M, F)

so that in local components

    L_strain strain' = (-kappa x M - nu x F, -kappa x F - f) - L_T T' - L_s
"""

from __future__ import annotations

import casadi as ca

from model.loaded.state import LoadState, to_local
from model.loaded.tendon_rates import TINY, length_rate, tension_rate
from model.rotations import multiply, rotate
from model.statics.algebra import solve_symmetric

# Sweeps of the fixed point T' -> strain' -> T', which contracts by mu T y y' / EJ or so: 0.05, or
# 0.3 where tendons pull hard along a steep taper.
_SWEEPS = 16

# Strain, pull and data of a cross-section: what its wrench depends on.
Section = tuple[ca.SX, ca.SX, ca.SX]


class LoadEquations(LoadState):
    """The equations of one form of loads on one statics; see LoadState."""

    def rate(
        self, x: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX, numbers: ca.SX
    ) -> ca.SX:
        """Return the derivative of the state along s.

        With friction the tensions fall with the turning of the tendons, which depends on the
        strains' rates, which depend on the tensions' rates: a fixed point, found by sweeps.
        """
        args = [pull, data, pull_rate, data_rate, numbers]
        found = self.swept(x, args, None)
        for _ in range(_SWEEPS * (self.n_tension > 0)):
            found = self.swept(x, args, found[self.strains])
        return found

    def swept(self, x: ca.SX, args: list[ca.SX], strain_rate: ca.SX | None) -> ca.SX:
        """Return the derivative of the state, friction by a guess of that of the strains."""
        pull, data, pull_rate, data_rate, numbers = args
        pose, strain, _, tensions = self.split(x)
        kappa, nu = self.twist(x, pull, data, numbers)
        drag = self._drag(pose, nu, numbers)
        at = (strain, self.pulled(pull, tensions), data)
        sides = self._wrench_rate(x, at, kappa, nu, drag, numbers)
        fall = ca.SX.zeros(self.n_tension)
        varied = self.pulled(pull_rate, tensions)
        if strain_rate is not None and self.n_tension:
            fall = tension_rate(self, x, strain_rate, kappa, numbers)
            varied = varied + self.pulled(pull, fall)
        own_rate = self._strain_rate(at, varied, data_rate, sides)
        turn = multiply(pose[:4], ca.vertcat(0, kappa)) / 2
        force_rate = -drag if self.n_force else ca.SX.zeros(0)
        spooled = length_rate(self, strain, kappa, nu, numbers)
        shape_rate = ca.vertcat(turn, rotate(pose[:4], nu), own_rate)
        return ca.vertcat(shape_rate, force_rate, fall, spooled)

    def _drag(self, pose: ca.SX, nu: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return the drag per unit reference length in the base frame (3,) [N/m]; see Current."""
        if self.form.velocity is None:
            return ca.SX.zeros(3)
        v, t = ca.SX(ca.DM(self.form.velocity)), rotate(pose[:4], ca.SX([1, 0, 0]))
        across = v - t * ca.dot(t, v)
        speed = ca.sqrt(ca.sumsqr(across) + TINY)
        return self.numbers(numbers)["drag"] * nu[0] * speed * across

    def _wrench_rate(
        self, x: ca.SX, at: Section, kappa: ca.SX, nu: ca.SX, drag: ca.SX, numbers: ca.SX
    ) -> ca.SX:
        """Return the derivative along s of the local wrench of the loads beyond."""
        moment = self.statics.wrench(*at)[:3]
        if not self.form.force:
            return self.wrench(-ca.cross(kappa, moment), ca.SX.zeros(3))
        force = self.force(x, numbers)
        spread = drag + self.numbers(numbers)["density"] if self.form.weight else drag
        turned = -ca.cross(kappa, force) - to_local(x[:7], spread)
        return self.wrench(-ca.cross(kappa, moment) - ca.cross(nu, force), turned)

    def _strain_rate(
        self, at: Section, pull_rate: ca.SX, data_rate: ca.SX, wrench_rate: ca.SX
    ) -> ca.SX:
        """Return the derivative of the strains along s that the wrench's asks for."""
        strain, pull, data = (ca.SX.sym("at", *v.shape) for v in at)
        wrench = self.statics.wrench(strain, pull, data)
        along = ca.jtimes(wrench, pull, pull_rate) + ca.jtimes(wrench, data, data_rate)
        rate = solve_symmetric(ca.jacobian(wrench, strain), wrench_rate - along)
        return ca.substitute([rate], [strain, pull, data], list(at))[0]
