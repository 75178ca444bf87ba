"""An arm in equilibrium on one mesh, as a value: what a settled shape holds and reads.

By collocation, or marched along the arm where nothing couples its cross-sections.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.cross_section.law import reported
from model.equilibrium.dense import poses_and_strains, sliding_tensions
from model.equilibrium.linearised import Linearised
from model.errors import CollapsedError, UnsettledSectionError
from model.mesh import Mesh
from model.paths import Array
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.transcription.system import System
from model.unloaded.marched import Marched
from model.unloaded.sections import LEAST_STRETCH


@dataclass(frozen=True, eq=False)
class Collocated:
    """An equilibrium by collocation.

    Attributes
    ----------
    here : Linearised
        The equations, linearised there on demand.
    refinement : int
        Of the mesh.
    """

    point: Linearised
    refinement: int

    @property
    def system(self) -> System:
        """The equations."""
        return self.point.system

    @property
    def states(self) -> Linearised:
        """What equilibria on other meshes begin with."""
        return self.point

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""
        return self.point.tensions

    @property
    def mesh(self) -> Mesh:
        """The mesh of N elements."""
        return self.system.mesh

    @property
    def poses(self) -> Array:
        """Quaternions and positions [m] at the nodes (N + 1, 7)."""
        return self.system.poses(self.point.states)

    @property
    def stretch_at(self) -> Array:
        """Arc lengths (K,) of the stages, then of both ends of the elements [m]."""
        s = self.mesh.s
        return np.concatenate([self.system.s, s[:-1], s[1:]])

    @cached_property
    def stretch(self) -> Array:
        """The stretch 1 + q (K,) at `stretch_at`."""
        of, m = self.system.of, self.system.of.form.stages
        stages = reported(of.form.law, self.system.strains(self.point.states))[:, 3] + 1
        ends = [stages.reshape(-1, m) @ gauss(m).at(x) for x in (0.0, 1.0)]
        return np.concatenate([stages, *ends])

    @property
    def bend(self) -> float:
        """Curvature times the body's radius, at most, at the stages."""
        arm, at = self.system.arm, self.system.s
        rows = reported(self.system.of.form.law, self.system.strains(self.point.states))
        curvature = np.hypot(rows[:, 1], rows[:, 2])
        return float((arm.radius.evaluate(at, arm.length)[0] * curvature).max())

    @property
    def lengths(self) -> Array:
        """Lengths of the tendons (n_tendons,) as the equations have them [m]."""
        return self.point.lengths

    @property
    def scheme(self) -> str:
        """The name of the scheme."""
        return f"gauss{2 * self.system.of.form.stages}"

    @property
    def machine_code(self) -> bool:
        """Whether it is found by compiled kernels."""
        return self.system.of.form.machine_code

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return poses (K, 7) and strains at arc lengths s (K,) [m], by elements that end there.

        Strains (K, 4) are tau, xi, k, q; with nu_n, nu_b (K, 6) where sections may shear.
        """
        poses, v = poses_and_strains(self.system, self.point.x, s)
        nodes = np.minimum(np.searchsorted(self.mesh.s, s), self.mesh.steps)
        exact = (self.mesh.s[nodes] == s)[:, None]
        strains = reported(self.system.of.form.law, v)
        return np.where(exact, self.poses[nodes], poses), strains

    def tensions_at(self, s: Array, place: Places, tendon: Places) -> Array:
        """Return the tensions (P,) of tendons where they cross arc lengths s[place] [N].

        With friction they fall along the arm.
        """
        return sliding_tensions(self.system, self.point.x, s, place, tendon)


Equilibrium = Collocated | Marched


def check_sections(at: Equilibrium, which: str = "") -> None:
    """Refuse an equilibrium whose 1 + q is not a number where a section has no equilibrium.

    `which` says which of many it is. Raises UnsettledSectionError.
    """
    if np.isnan(at.stretch.min()):
        lost = int(np.argmax(np.isnan(at.stretch)))
        raise UnsettledSectionError(float(at.stretch_at[lost]), which)


def check_stretch(at: Equilibrium, which: str = "") -> None:
    """Refuse an equilibrium whose 1 + q is not above 0 somewhere.

    Raises CollapsedError, and as check_sections does.
    """
    check_sections(at, which)
    worst = int(at.stretch.argmin())
    if not at.stretch[worst] > LEAST_STRETCH:
        raise CollapsedError(float(at.stretch_at[worst]), float(at.stretch[worst]), which)
