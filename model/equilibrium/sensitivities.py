"""How an equilibrium answers to a force and moment on its midline, and to its tendons.

By the implicit function theorem through the equations of equilibrium: one factorisation, and a
right-hand side for each of a force's and a moment's components and for each tension.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stands, turns
from model.paths import Array


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """The derivatives of an equilibrium's pose at a node and of its tendons' lengths.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    node : int
        The node that is pushed and watched.
    """

    here: Linearised
    node: int

    @cached_property
    def _by_wrench(self) -> Array:
        return -self.here.solve(self.here.system.by_wrench(self.here.x, self.node))

    @cached_property
    def pose_wrench(self) -> Array:
        """Displacement [m] and rotation [rad] per force [N] and moment [N m] (6, 6), base frame."""
        return self._pose(self._by_wrench)

    @cached_property
    def pose_tension(self) -> Array:
        """The same per newton in each tendon at its motor (6, n_tendons)."""
        return self._pose(self.here.by_tensions)

    @property
    def lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""
        return self.here.lengths

    @cached_property
    def length_wrench(self) -> Array:
        """Lengths of the tendons per force and moment (n_tendons, 6)."""
        return np.asarray(self.here.length_jacobian @ self._by_wrench)

    @property
    def length_tension(self) -> Array:
        """Lengths of the tendons per newton (n_tendons, n_tendons) [m/N]."""
        return self.here.length_tension

    @cached_property
    def stable(self) -> bool:
        """Whether the equilibrium stands, tensions held."""
        return stands(self.here)

    def _pose(self, moved: Array) -> Array:
        """Return displacement and rotation (6, n) of the node that changes of the states are."""
        of = self.here.system.of
        places = of.nodes[self.node]
        q = self.here.states[places[:4]]
        return np.vstack([moved[places[4:7]], 4 * turns(q[None, :])[0].T @ moved[places[:4]]])
