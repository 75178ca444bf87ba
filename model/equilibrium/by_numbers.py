"""How a settled shape moves with numbers of its arm and scene: the implicit function theorem.

With g(x, p) = 0 the equations of equilibrium and p(theta) their numbers, states move by
dx = - (dg/dx)^-1 dg/dp dp/dtheta: one factorisation, a right-hand side for each number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.cross_section.reported import kinematics
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import turns
from model.paths import Array
from model.rotations import matrices
from model.transcription.layout import POSE
from model.transcription.neighbours import NumberSlopes


@dataclass(frozen=True, eq=False)
class ByNumbers:
    """The derivatives of an equilibrium by K numbers of arm and scene.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    slopes : NumberSlopes
        Of the numbers of its equations.
    tensions : (n_tendons, K)
        Of its tensions [N].
    """

    here: Linearised
    slopes: NumberSlopes
    tensions: Array

    @cached_property
    def states(self) -> Array:
        """Of the states (n_states, K)."""
        right = self.here.system.by_numbers(self.here.x) @ self.slopes.p
        found = -self.here.solve(np.asfortranarray(right))
        if self.tensions.any():
            found += self.here.by_tensions @ self.tensions
        return found

    def pose(self, node: int) -> Array:
        """Displacement [m] and rotation [rad] at the arc length of a node (6, K), base frame."""
        places = self.here.system.of.nodes[node, :POSE]
        q, moved = self.here.states[places[:4]], self.states[places]
        found = np.vstack([moved[4:], 4 * turns(q[None, :])[0].T @ moved[:4]])
        if self.slopes.s[node].any():
            found -= np.outer(along(self.here, node), self.slopes.s[node])
        return np.asarray(found)

    @cached_property
    def lengths(self) -> Array:
        """Of the lengths of the tendons (n_tendons, K) [m]."""
        slopes = self.here.system.length_slopes(self.here.x)
        return np.asarray(slopes @ self.states + self.direct_lengths)

    @cached_property
    def direct_lengths(self) -> Array:
        """Of the lengths of the tendons in a shape that stays (n_tendons, K) [m]."""
        return np.asarray(self.here.system.lengths_by_numbers(self.here.x) @ self.slopes.lengths)


def along(here: Linearised, node: int) -> Array:
    """Return how pose moves along the arm at a node: u' [-], rotation [rad/m] (6,), base frame."""
    system = here.system
    pose, v = poses_and_strains(system, here.x, system.mesh.s[node : node + 1])
    kappa, nu = kinematics(system.of.form.law, v)
    return np.ravel(matrices(pose[0, :4]) @ np.column_stack([nu[0], kappa[0]]), "F")
