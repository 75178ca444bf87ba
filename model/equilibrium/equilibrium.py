"""An arm in equilibrium on one mesh, as a value: what a settled shape holds and reads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from model.cross_section.reported import reported
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.sliding import pulls
from model.mesh import Mesh
from model.paths import Array
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.transcription.system import System


class Equilibrium(Protocol):
    """See Collocated, and model.unloaded.marched.Marched where nothing couples the sections.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    mesh : Mesh
        N elements.
    poses : (N + 1, 7)
        Quaternions and positions [m] at its nodes.
    stretch_at, stretch : (K,)
        Arc lengths [m], and 1 + q there.
    bend : float
        Curvature times the body's radius, at most, where the equations are evaluated.
    lengths : (n_tendons,)
        Of the tendons [m].
    refinement : int
        Of the mesh.
    scheme : str
        By which it was found.
    machine_code : bool
        Whether by compiled kernels.
    """

    @property
    def tensions(self) -> Array:
        """See the class."""

    @property
    def mesh(self) -> Mesh:
        """See the class."""

    @property
    def poses(self) -> Array:
        """See the class."""

    @property
    def stretch_at(self) -> Array:
        """See the class."""

    @property
    def stretch(self) -> Array:
        """See the class."""

    @property
    def bend(self) -> float:
        """See the class."""

    @property
    def lengths(self) -> Array:
        """See the class."""

    @property
    def refinement(self) -> int:
        """See the class."""

    @property
    def scheme(self) -> str:
        """See the class."""

    @property
    def machine_code(self) -> bool:
        """See the class."""

    @property
    def states(self) -> Linearised | None:
        """What equilibria on other meshes begin with; None where there are no unknowns."""

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return poses (K, 7) and strains at arc lengths s (K,) [m].

        Strains (K, 4) are tau, xi, k, q; with nu_n, nu_b (K, 6) where sections may slide.
        """

    def tensions_at(self, s: Array, place: Places, tendon: Places) -> Array:
        """Return the tensions (P,) of tendons where they cross arc lengths s[place] [N]."""


@dataclass(frozen=True, eq=False)
class Collocated:
    """An equilibrium by collocation; see Equilibrium.

    Attributes
    ----------
    here : Linearised
        The equations, linearised there on demand.
    refinement : int
    """

    here: Linearised
    refinement: int

    @property
    def system(self) -> System:
        """The equations."""
        return self.here.system

    @property
    def states(self) -> Linearised:
        """See Equilibrium."""
        return self.here

    @property
    def tensions(self) -> Array:
        """See Equilibrium."""
        return self.here.tensions

    @property
    def mesh(self) -> Mesh:
        """See Equilibrium."""
        return self.system.mesh

    @property
    def poses(self) -> Array:
        """See Equilibrium."""
        return self.system.poses(self.here.states)

    @property
    def stretch_at(self) -> Array:
        """See Equilibrium: those of the stages, then of both ends of the elements."""
        s = self.mesh.s
        return np.concatenate([self.system.s, s[:-1], s[1:]])

    @cached_property
    def stretch(self) -> Array:
        """See Equilibrium."""
        return stretch_of(self.system, self.here.states)

    @property
    def bend(self) -> float:
        """See Equilibrium: at the stages."""
        arm, at = self.system.arm, self.system.s
        rows = reported(self.system.of.form.law, self.system.strains(self.here.states))
        curvature = np.hypot(rows[:, 1], rows[:, 2])
        return float((arm.radius.evaluate(at, arm.length)[0] * curvature).max())

    @property
    def lengths(self) -> Array:
        """See Equilibrium: as the equations have them, to which winches hold the tendons."""
        return self.here.lengths

    @property
    def scheme(self) -> str:
        """See Equilibrium."""
        return f"gauss{2 * self.system.of.form.stages}"

    @property
    def machine_code(self) -> bool:
        """See Equilibrium."""
        return self.system.of.form.machine_code

    def at(self, s: Array) -> tuple[Array, Array]:
        """See Equilibrium: between the nodes by an element that ends there."""
        poses, v = poses_and_strains(self.system, self.here.x, s)
        nodes = np.minimum(np.searchsorted(self.mesh.s, s), self.mesh.steps)
        exact = (self.mesh.s[nodes] == s)[:, None]
        strains = reported(self.system.of.form.law, v)
        return np.where(exact, self.poses[nodes], poses), strains

    def tensions_at(self, s: Array, place: Places, tendon: Places) -> Array:
        """See Equilibrium: with friction they fall along the arm."""
        return pulls(self.system, self.here.x, s, place, tendon)


def stretch_of(system: System, states: Array) -> Array:
    """Return 1 + q (..., K) at the stages, then at both ends of the elements."""
    of, sets = system.of, states.shape[:-1]
    strains = states[..., of.stages].reshape(-1, of.form.strains)
    stages = reported(of.form.law, strains)[:, 3].reshape(*sets, -1) + 1
    inside = stages.reshape(*sets, of.elements, -1)
    ends = [inside @ gauss(of.form.stages).at(x) for x in (0.0, 1.0)]
    return np.asarray(np.concatenate([stages, *ends], axis=-1))
