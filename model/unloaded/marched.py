"""An arm whose cross-sections nothing couples, marched along it: its equilibrium as a value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.effects import PrintedStatics
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.unloaded.tendon_lengths import tendon_lengths

# Gauss points of an element by which lengths are integrated as printed.
_POINTS = 3


class March(Protocol):
    """The map of an arm on a mesh; see ClosedForm and PrintedMap."""

    arm: Arm
    scene: Scene
    mesh: Mesh
    name: str
    refinement: int
    machine_code: bool
    stretch_at: Array

    def run(self, tensions: Array) -> tuple[Array, Array, Array]:
        """Return the rows at the nodes (N + 1, 7 or more), 1 + q (K,) at `stretch_at`, strains."""

    def bend(self, strains: Array) -> float:
        """Return curvature times the body's radius, at most, of the strains that `run` returns."""

    def many(self, tensions: Array, nodes: Sequence[int]) -> tuple[Array, Array]:
        """Return poses (M, K, 7) at K nodes in order and the least 1 + q (M,) of many arms.

        Under tensions (M, n_tendons); NaN where one has no equilibrium.
        """

    def dense(self, tensions: Array, rows: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s (N,)."""


@dataclass(frozen=True, eq=False)
class Marched:
    """An equilibrium marched along the arm; see model.equilibrium.equilibrium.Equilibrium.

    Attributes
    ----------
    march : March
    rows : (N + 1, 7 or more)
        At the nodes: poses, then strains where these are marched as well.
    strains
        As `bend` takes them.
    """

    march: March
    tensions: Array
    rows: Array
    stretch: Array
    strains: Array

    @classmethod
    def under(cls, march: March, tensions: Array) -> Marched:
        """Return the equilibrium under tensions (n_tendons,)."""
        return cls(march, tensions, *march.run(tensions))

    @property
    def poses(self) -> Array:
        """See Equilibrium."""
        return self.rows[:, :7]

    @property
    def mesh(self) -> Mesh:
        """See Equilibrium."""
        return self.march.mesh

    @property
    def stretch_at(self) -> Array:
        """See Equilibrium."""
        return self.march.stretch_at

    @property
    def refinement(self) -> int:
        """See Equilibrium."""
        return self.march.refinement

    @property
    def scheme(self) -> str:
        """See Equilibrium."""
        return self.march.name

    @property
    def bend(self) -> float:
        """See Equilibrium."""
        return self.march.bend(self.strains)

    @property
    def machine_code(self) -> bool:
        """See Equilibrium."""
        return self.march.machine_code

    @property
    def states(self) -> None:
        """See Equilibrium: a march has no unknowns."""

    def at(self, s: Array) -> tuple[Array, Array]:
        """See Equilibrium: a step from the nodes beside s."""
        return self.march.dense(self.tensions, self.rows, s)

    def tensions_at(self, s: Array, place: Places, tendon: Places) -> Array:
        """See Equilibrium: the same all along."""
        return np.asarray(self.tensions[tendon])

    @cached_property
    def lengths(self) -> Array:
        """See Equilibrium: the integral of ``|du_c/ds|`` by Gauss quadrature."""
        arm, scene, mesh = self.march.arm, self.march.scene, self.mesh
        if not scene.has(PrintedStatics):
            return tendon_lengths(arm, scene, self.machine_code)(self.tensions).lengths
        law = cross_section_of(scene, arm.is_curved)
        method, h = gauss(_POINTS), np.diff(mesh.s)[:, None]
        s, weight = (mesh.s[:-1, None] + h * method.c).ravel(), (h * method.b).ravel()
        sections = Sections(arm, scene, law, s, np.repeat(mesh.active, _POINTS))
        return sections.lengths(strains_of(law, self.at(s)[1]), weight)
