"""Statics of a cross-section that carries loads: strains against the wrench of what lies beyond.

The wrench is the moment and the force (F, M) of the loads on the part between section and tip, in
local components. L(strain) = the wrench that strains and tendons balance; equilibrium is
L = (M, those of F that do work on the strains).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca
import numpy as np

from model.arm import Arm
from model.paths import Array
from model.statics.energy import SectionEnergy
from model.statics.sums import slope_sums, tendon_sums
from model.stations import Stations


class LoadedStatics(Protocol):
    """As Statics, in three dimensions and with the loads beyond the section."""

    def __hash__(self) -> int:
        """Return the hash of the value."""

    @property
    def size(self) -> int:
        """The number of strains that are states: three curvatures, then what extends and slides."""

    @property
    def forces(self) -> tuple[int, ...]:
        """Which local components of the force do work on the strains after the curvatures."""

    @property
    def n_pull(self) -> int:
        """See Statics.n_pull."""

    @property
    def n_data(self) -> int:
        """See Statics.n_data."""

    @property
    def pull_varies(self) -> bool:
        """Whether pull changes along a segment at constant tensions."""

    def pulls(self, arm: Arm, at: Stations) -> tuple[Array, Array]:
        """See Statics.pulls."""

    def data(self, at: Stations) -> tuple[Array, Array]:
        """See Statics.data."""

    def wrench(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return L (size,): moments about t, n, b [N m], then forces [N]."""

    def twist(self, strain: ca.SX, pull: ca.SX, data: ca.SX, force: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return kappa and nu (3,) per unit reference length, under the local force (3,)."""

    def tangent(self, j: int, strain: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """Return the tangent c (3,) along which tendon j pulls."""

    def run(self, j: int, strain: ca.SX, kappa: ca.SX, nu: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """Return the derivative along s (3,) of the curve that tendon j runs along."""

    def state(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """Return the strains that are states (size,) of kappa and nu (3,)."""


@dataclass(frozen=True)
class ReferenceLoaded:
    """The paper's balance, eqs. (8), (9) with (6), in all three directions.

    Strains are omega = (tau, xi, k): (K + sum T y2 (1 - d d^T)) omega - sum T y t x d = M. The
    longitudinal strain follows, E A q = t . (F - sum T c), and with shear the slide across,
    G A k_s nu_n = n . (F - sum T c).

    Attributes
    ----------
    cos, sin
        Direction (n, b) of each tendon.
    extension : bool
        Whether the arm shortens.
    shear : float or None
        G A k_s over E A, with shear.
    """

    cos: tuple[float, ...]
    sin: tuple[float, ...]
    extension: bool
    shear: float | None = None
    size: int = field(default=3, init=False)
    forces: tuple[int, ...] = field(default=(), init=False)
    n_pull: int = field(default=8, init=False)
    n_data: int = field(default=3, init=False)
    pull_varies: bool = field(default=True, init=False)

    def pulls(self, arm: Arm, at: Stations) -> tuple[Array, Array]:
        """See Statics.pulls: six sums over tendons, and S[T y' cos], S[T y' sin]."""
        (sums, rates), (slopes, curves) = tendon_sums(arm, at), slope_sums(arm, at)
        return np.concatenate([sums, slopes], axis=1), np.concatenate([rates, curves], axis=1)

    def data(self, at: Stations) -> tuple[Array, Array]:
        """See Statics.data."""
        return at.body, at.body_rate

    def wrench(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See LoadedStatics.wrench."""
        _, c, s, cc, sc, ss = ca.vertsplit(pull[:6])
        EJ, GI = data[1], data[2]
        tau, xi, k = ca.vertsplit(strain)
        about_n = (EJ + ss) * xi - sc * k + s
        about_b = (EJ + cc) * k - sc * xi - c
        return ca.vertcat((GI + cc + ss) * tau, about_n, about_b)

    def twist(self, strain: ca.SX, pull: ca.SX, data: ca.SX, force: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See LoadedStatics.twist."""
        total, c, s, *_, c_slope, s_slope = ca.vertsplit(pull)
        tau, xi, k = ca.vertsplit(strain)
        EA, stretch, slide = data[0], ca.SX(1), ca.SX.zeros(2)
        if self.extension:
            stretch += (k * c - xi * s - total + force[0]) / EA
        if self.shear is not None:
            pulled = ca.vertcat(c_slope - tau * s, s_slope + tau * c)
            slide = (force[1:] - pulled) / (self.shear * EA)
        return stretch * strain, ca.vertcat(stretch, slide)

    def tangent(self, j: int, strain: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """See LoadedStatics.tangent: c = t + y' d + y omega x d."""
        d = ca.vertcat(0, self.cos[j], self.sin[j])
        return ca.vertcat(1, 0, 0) + y_rate * d + y * ca.cross(strain, d)

    def run(self, j: int, strain: ca.SX, kappa: ca.SX, nu: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """See LoadedStatics.run: u_c' of eq. (6), which is not quite the tangent of the balance."""
        d = ca.vertcat(0, self.cos[j], self.sin[j])
        return nu + y_rate * d + y * ca.cross(kappa, d)

    def state(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See LoadedStatics.state: per unit deformed length."""
        return kappa / nu[0]


@dataclass(frozen=True)
class ExactLoaded(SectionEnergy):
    """The gradient of the section's energy; strains are kappa, lambda, nu_n and nu_b."""

    pull_varies: bool = field(default=False, init=False)

    @property
    def forces(self) -> tuple[int, ...]:
        """See LoadedStatics.forces."""
        return (0,) * self.extension + (1, 2) * (self.shear is not None)

    def wrench(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See LoadedStatics.wrench."""
        v = ca.SX.sym("v", self.size)
        return ca.substitute([ca.gradient(self(v, pull, data), v)], [v], [strain])[0]

    def twist(self, strain: ca.SX, pull: ca.SX, data: ca.SX, force: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See LoadedStatics.twist: the strains themselves."""
        return self.kappa_nu(strain)

    def run(self, j: int, strain: ca.SX, kappa: ca.SX, nu: ca.SX, y: ca.SX, y_rate: ca.SX) -> ca.SX:
        """See LoadedStatics.run: the tangent."""
        return self.tangent(j, strain, y, y_rate)

    def state(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See LoadedStatics.state."""
        stretch = nu[0] if self.extension else ca.SX(0, 1)
        slide = nu[1:] if self.shear is not None else ca.SX(0, 1)
        return ca.vertcat(kappa, stretch, slide)
