"""What the integrators ask of the statics of a cross-section, and which statics a scene means."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import casadi as ca

from model.effects import Extension, PrintedStatics
from model.scene import Scene


class Statics(Protocol):
    """Relations between tendon sums, body and strains at one cross-section, as SX expressions.

    The arguments are those of model.stations: `pull` (6,) the sums over tendons, `body` (3,)
    E A, E J, G I, and their derivatives along s. The strains are (xi, k) or (tau, xi, k): curvature
    per unit deformed length about t, n, b [1/m], torsion only where the statics produce any.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the strains that are states."""

    def rate(
        self, strain: ca.SX, pull: ca.SX, body: ca.SX, pull_rate: ca.SX, body_rate: ca.SX
    ) -> ca.SX:
        """Return the derivative of the strains along s [1/m2]: the tip-to-base equations."""

    def jump(self, strain: ca.SX, outer: ca.SX, inner: ca.SX, body: ca.SX) -> ca.SX:
        """Return the strains on the base side of an anchorage from those on its tip side.

        `outer` and `inner` are the tendon sums on the tip and the base side.
        """

    def stretch(self, strain: ca.SX, pull: ca.SX, body: ca.SX) -> ca.SX:
        """Return the longitudinal strain q [-]."""


@runtime_checkable
class ClosedStatics(Statics, Protocol):
    """Statics whose strains are in closed form, so that nothing needs integrating but the pose."""

    def solve(self, pull: ca.SX, body: ca.SX, moment: ca.SX) -> ca.SX:
        """Return the strains under an external moment (components like the strains) [N m]."""

    def moment(self, strain: ca.SX, pull: ca.SX, body: ca.SX) -> ca.SX:
        """Return the external moment that balances body and tendons [N m]."""


def statics_of(scene: Scene) -> Statics:
    """Return the statics that a scene calls for."""
    from model.statics.printed import Printed
    from model.statics.reference import ReferenceTangent

    extension = scene.has(Extension)
    return Printed(extension) if scene.has(PrintedStatics) else ReferenceTangent(extension)


def curvature(names: tuple[str, ...], strain: ca.SX) -> ca.SX:
    """Return (tau, xi, k), with tau = 0 where the statics carry no torsion."""
    return strain if "tau" in names else ca.vertcat(0, strain)
