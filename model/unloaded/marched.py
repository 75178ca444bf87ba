"""An arm whose cross-sections nothing couples, marched along it: its equilibrium as a value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.cross_section import cross_section_of
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.effects import PrintedStatics
from model.mesh import Mesh
from model.paths import Array
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.unloaded.closed_form import ClosedForm
from model.unloaded.printed import PrintedMap
from model.unloaded.tendon_lengths import tendon_lengths

# Gauss points of an element by which lengths are integrated as printed.
_POINTS = 3


March = ClosedForm | PrintedMap


@dataclass(frozen=True, eq=False)
class Marched:
    """An equilibrium marched along the arm; see model.equilibrium.equilibrium.Collocated.

    Attributes
    ----------
    march : March
    tensions : (n_tendons,)
        [N].
    rows : (N + 1, 7 or more)
        At the nodes: poses, then strains where these are marched as well.
    stretch : (K,)
        1 + q at the march's `stretch_at`.
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
        """See Collocated."""
        return self.rows[:, :7]

    @property
    def mesh(self) -> Mesh:
        """See Collocated."""
        return self.march.mesh

    @property
    def stretch_at(self) -> Array:
        """See Collocated."""
        return self.march.stretch_at

    @property
    def refinement(self) -> int:
        """See Collocated."""
        return self.march.refinement

    @property
    def scheme(self) -> str:
        """See Collocated."""
        return self.march.name

    @property
    def bend(self) -> float:
        """See Collocated."""
        return self.march.bend(self.strains)

    @property
    def machine_code(self) -> bool:
        """See Collocated."""
        return self.march.machine_code

    @property
    def states(self) -> None:
        """See Collocated: a march has no unknowns."""

    def at(self, s: Array) -> tuple[Array, Array]:
        """See Collocated: a step from the nodes beside s."""
        return self.march.dense(self.tensions, self.rows, s)

    def tensions_at(self, s: Array, place: Places, tendon: Places) -> Array:
        """See Collocated: the same all along."""
        return np.asarray(self.tensions[tendon])

    @cached_property
    def lengths(self) -> Array:
        """See Collocated: the integral of ``|du_c/ds|`` by Gauss quadrature."""
        arm, scene, mesh = self.march.arm, self.march.scene, self.mesh
        if not scene.has(PrintedStatics):
            return tendon_lengths(arm, scene, self.machine_code)(self.tensions).lengths
        law = cross_section_of(scene, arm.is_curved)
        method, h = gauss(_POINTS), np.diff(mesh.s)[:, None]
        s, weight = (mesh.s[:-1, None] + h * method.c).ravel(), (h * method.b).ravel()
        sections = Sections(arm, scene, law, s, np.repeat(mesh.active, _POINTS))
        return sections.lengths(strains_of(law, self.at(s)[1]), weight)
