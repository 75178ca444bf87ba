"""Viscous resistance to a change of the strains, by which an arm that jumps comes to rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import rest_stiffness
from model.paths import Array


class Drag(NamedTuple):
    """Viscous resistance to a change of the strains: what a step is damped by.

    Attributes
    ----------
    share : float
        Of the stiffness of the body at rest.
    states : (n_states,)
        Those that resistance is against.
    """

    share: float
    states: Array


@dataclass(frozen=True, eq=False)
class Dragged(Linearised):
    """Equations linearised with viscous resistance to what the strains change."""

    drag: Drag = field(kw_only=True)

    @cached_property
    def _stiff(self) -> Array:
        """The resistance of each state (n_states,); 0 but for the strains."""
        found = np.zeros(self.system.of.n_states)
        found[np.ravel(self.system.of.stages)] = self.drag.share * rest_stiffness(self.system)[1]
        return found

    @cached_property
    def residual(self) -> Array:
        """See Linearised.residual."""
        return self.system.residual(self.x) + self._stiff * (self.states - self.drag.states)

    @cached_property
    def nonzeros(self) -> Array:
        """See Linearised.nonzeros."""
        row, column = self.band.rows, self.band.columns - self.band.first
        found, own = self.system.jacobian(self.x).copy(), np.flatnonzero(row == column)
        found[own] += self._stiff[row[own]]
        return found
