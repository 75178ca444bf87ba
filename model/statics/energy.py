"""The energy of a section: exact tendons on a linear or a neo-Hookean body."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.arm import Arm
from model.paths import Array
from model.stations import Stations, crossing

# Keeps the root differentiable where a tendon has no length left, wide enough for the rounding of
# its length (1e-16) to be small beside it.
TINY = 1e-24


@dataclass(frozen=True)
class SectionEnergy:
    """Energy per unit reference length; see ExactTendons, NeoHookean and Shear.

    Its strains v are per unit reference length: kappa_t with torsion, kappa_n, kappa_b, then
    lambda = 1 + q with extension, then nu_n, nu_b with shear. `pull` are the tensions of the
    tendons that cross the section, `data` is E A, E J, G I, then y_i, then y_i'.

    Attributes
    ----------
    section, cos, sin
        Section index and direction (n, b) of each tendon.
    extension, rubber, anticlastic, torsion : bool
        Which effects are called for.
    shear : float or None
        G A k_s over E A, with shear.
    """

    section: tuple[int, ...]
    cos: tuple[float, ...]
    sin: tuple[float, ...]
    extension: bool
    rubber: bool
    anticlastic: bool
    torsion: bool = False
    shear: float | None = None

    @property
    def size(self) -> int:
        """The number of strains v."""
        return 2 + self.torsion + self.extension + 2 * (self.shear is not None)

    @property
    def n_pull(self) -> int:
        """The size of pull: a tension for each tendon."""
        return len(self.section)

    @property
    def n_data(self) -> int:
        """The size of data."""
        return 3 + 2 * self.n_sections

    @property
    def n_sections(self) -> int:
        """The number of anchorage sections."""
        return max(self.section) + 1

    def pulls(self, arm: Arm, at: Stations) -> tuple[Array, Array]:
        """See Statics.pulls: 1 for a tendon that crosses."""
        maps = crossing(arm, at)[:, :, None] * np.eye(arm.n_tendons)
        return maps, np.zeros_like(maps)

    def data(self, at: Stations) -> tuple[Array, Array]:
        """See Statics.data."""
        return (
            np.vstack([at.body, at.y, at.y_rate]),
            np.vstack([at.body_rate, at.y_rate, at.y_curve]),
        )

    def kappa_nu(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return curvature (3,) and tangent (3,) per unit reference length in (t, n, b)."""
        zero, i = ca.SX(0), int(self.torsion)
        kappa = ca.vertcat(v[0] if self.torsion else zero, v[i], v[i + 1])
        stretch = v[i + 2] if self.extension else ca.SX(1)
        slide = v[-2:] if self.shear is not None else ca.SX.zeros(2)
        return kappa, ca.vertcat(stretch, slide)

    def tangent(self, j: int, v: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """Return the tangent c (3,) of tendon j: physics of ExactTendons and NeoHookean."""
        kappa, nu = self.kappa_nu(v)
        cos, sin = self.cos[j], self.sin[j]
        inward = y * (kappa[2] * cos - kappa[1] * sin)
        shrink = 1 / ca.sqrt(nu[0]) if self.rubber else ca.SX(1)
        along = nu[0] - shrink * inward
        if self.anticlastic:
            across = y * (kappa[2] * sin + kappa[1] * cos)
            along -= (inward**2 - across**2) / (4 * nu[0] ** 2)
        side = nu[1:] + shrink * y_rate * ca.vertcat(cos, sin)
        if self.torsion:
            side = side + shrink * y * kappa[0] * ca.vertcat(-sin, cos)
        return ca.vertcat(along, side)

    def __call__(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the energy per unit reference length, tendons included [N]."""
        energy = self._body(v, data)
        for j, i in enumerate(self.section):
            c = self.tangent(j, v, data[3 + i], data[3 + self.n_sections + i])
            energy += pull[j] * ca.sqrt(ca.sumsqr(c) + TINY)
        return energy

    def _body(self, v: ca.SX, data: ca.SX) -> ca.SX:
        kappa, nu = self.kappa_nu(v)
        stretch, EA, EJ, GI = nu[0], data[0], data[1], data[2]
        bend, twist = EJ * ca.sumsqr(kappa[1:]) / 2, GI * kappa[0] ** 2 / 2
        if self.rubber:
            energy = EA / 6 * (stretch**2 + 2 / stretch - 3)
            energy += bend * (1 + 2 / stretch**3) / (3 * stretch) + twist / stretch
        else:
            energy = EA / 2 * (stretch - 1) ** 2 + bend + twist
        if self.shear is not None:
            energy += self.shear * EA * ca.sumsqr(nu[1:]) / 2
        return energy
