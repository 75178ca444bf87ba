"""What the integrators ask of the statics of a cross-section."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import casadi as ca

from model.arm import Arm
from model.paths import Array
from model.stations import Stations


class Statics(Protocol):
    """Relations between tensions, section and strains at one cross-section, as SX expressions.

    A statics is a frozen value. What it needs of a cross-section are `pull` (n_pull,), numbers that
    are linear in the tensions, and `data` (n_data,), numbers of body and tendon paths. Its strains
    are (xi, k), with tau before and q after where these are not to be had from the others:
    curvature per unit deformed length about t, n, b [1/m], and longitudinal strain [-].
    """

    def __hash__(self) -> int:
        """Return the hash of the value."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the strains that are states."""

    @property
    def n_pull(self) -> int:
        """Return the size of pull."""

    @property
    def n_data(self) -> int:
        """Return the size of data."""

    def pulls(self, arm: Arm, at: Stations) -> tuple[Array, Array]:
        """Return the maps (N, n_pull, n_tendons) from tensions to pull, and their s-derivatives."""

    def data(self, at: Stations) -> tuple[Array, Array]:
        """Return data (n_data, N) and its s-derivative."""

    def rate(
        self, strain: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX
    ) -> ca.SX:
        """Return the derivative of the strains along s: the tip-to-base equations."""

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains on the base side of an anchorage from those on its tip side.

        `outer` and `inner` are the pull on the tip and the base side.
        """

    def stretch(self, strain: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the longitudinal strain q [-]."""


@runtime_checkable
class ClosedStatics(Statics, Protocol):
    """Statics whose strains follow from one cross-section, so that only the pose is integrated."""

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains without external load, NaN where there are none."""

    def unknowns(self, strain: ca.SX) -> ca.SX:
        """Return the unknowns v that the strains were found as."""

    def residual(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return what vanishes where v solves; as many as there are unknowns."""

    def strain(self, v: ca.SX) -> ca.SX:
        """Return the strains of unknowns v."""


def curvature(names: tuple[str, ...], strain: ca.SX) -> ca.SX:
    """Return (tau, xi, k), with tau = 0 where the statics carry no torsion."""
    zero = ca.SX(0)
    parts = [strain[names.index(name)] if name in names else zero for name in ("tau", "xi", "k")]
    return ca.vertcat(*parts)
