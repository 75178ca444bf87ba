"""The strains of a cross-section without loads, in closed form, by the laws of model.cross_section.

Without loads the wrench of body and tendons vanishes, so that each cross-section is in equilibrium
by itself and none is twisted: its strains follow from the tensions alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.energy import EnergySection
from model.cross_section.law import CrossSection, join
from model.cross_section.paper import PaperSection, resultants
from model.paths import Array
from model.scene import Scene
from model.stations import Stations, crossing, sides, tendon_paths
from model.unloaded.energy_statics import EnergyStatics


class ClosedStatics(Protocol):
    """The strains of a cross-section as SX expressions of its tendons; a frozen value.

    What it needs of a cross-section are `pull` (n_pull,), numbers that are linear in the tensions,
    and `data` (n_data,), numbers of body and tendon paths: E A, E J and G I first, then curvature
    at rest about n and b, if there is any.
    """

    def __hash__(self) -> int:
        """Return the hash of the value."""

    @property
    def law(self) -> CrossSection:
        """The law of the cross-section, without torsion and shear."""

    @property
    def n_pull(self) -> int:
        """The size of pull."""

    @property
    def each_alone(self) -> bool:
        """Whether pull are the tensions of the tendons that cross."""

    @property
    def n_data(self) -> int:
        """The size of data."""

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """Return the maps (N, n_pull, n_tendons) from tensions to pull."""

    def data(self, at: Stations) -> Array:
        """Return data (n_data, N)."""

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the wrench of body and tendons at strains v, which vanishes without loads."""

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains v where the wrench vanishes, NaN where there are none."""


@lru_cache(maxsize=256)
def closed_statics(scene: Scene, arm: Arm) -> ClosedStatics:
    """Return the statics of a scene without loads, for an arm's tendons."""
    law = cross_section_of(scene, arm.is_curved, torsion=False)
    if isinstance(law, PaperSection):
        return PaperStatics(law)
    assert isinstance(law, EnergySection)
    cos, sin = sides(arm)
    return EnergyStatics(law, arm.offset_of, tuple(cos.tolist()), tuple(sin.tolist()))


@dataclass(frozen=True)
class PaperStatics:
    """The paper's balance, linear in the strains; `pull` are the six resultants of the tendons.

    (K + sum T y2 (1 - d d^T)) omega = sum T y t x d, E A q = - sum T t . c; see PaperSection.
    """

    law: PaperSection
    n_pull: int = field(default=6, init=False)
    each_alone: bool = field(default=False, init=False)

    @property
    def n_data(self) -> int:
        """The size of data."""
        return 3 + 2 * self.law.curved

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """See ClosedStatics.pulls."""
        return resultant_maps(arm, at)

    def data(self, at: Stations) -> Array:
        """See ClosedStatics.data."""
        return np.vstack([at.body, at.rest])

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.wrench."""
        moment, along = self.law.tendons(v, pull)
        body = self.law.body(v, ca.vertcat(data[:3], 0, data[3:]))
        return body + join(self.law, moment, along, ca.SX(0, 1))

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See ClosedStatics.solve: curvatures, of which the stretch follows."""
        n = 2 + self.law.extension
        v = ca.SX.sym("v", n)
        wrench = self.wrench(v, pull, data)
        D, rest = ca.jacobian(wrench, v), ca.substitute([wrench], [v], [ca.SX.zeros(n)])[0]
        bend = _solve_2x2(D[:2, :2], -rest[:2])
        return ca.vertcat(bend, (-rest[2:] - D[2:, :2] @ bend) / ca.diag(D)[2:])


def resultant_maps(arm: Arm, at: Stations) -> Array:
    """Return the maps (N, 6, n_tendons) from tensions to the tendons' resultants at stations."""
    place, tendon = np.nonzero(crossing(arm, at))
    maps = np.zeros((at.s.size, 6, arm.n_tendons))
    n, b = tendon_paths(arm, at, place, tendon)[:2]
    for i, share in enumerate(resultants(n, b)):
        maps[place, i, tendon] = share
    return maps


def _solve_2x2(D: ca.SX, right: ca.SX) -> ca.SX:
    """Return D^-1 right for a positive definite 2x2 matrix."""
    det = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    first = (D[1, 1] * right[0] - D[0, 1] * right[1]) / det
    second = (D[0, 0] * right[1] - D[1, 0] * right[0]) / det
    return ca.vertcat(first, second)
