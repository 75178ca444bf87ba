"""The lengths of the tendons of an arm without loads, by tensions.

Data flow: tensions -> strains of the cross-sections -> lengths of the tendons by quadrature, and
their derivatives through the implicit function theorem on the balance of each cross-section.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.reported import reported
from model.errors import CollapsedError
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
from model.unloaded.sections import UnloadedSections, unloaded

# Strains are analytic between nodes: so many Gauss points on the coarsest mesh leave rounding only,
# whatever mesh poses have. Measured on the paper's arms and random ones at thrice their tensions.
_POINTS = 8


@dataclass(frozen=True, eq=False)
class Lengths:
    """Tendons under tensions.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    strains : (N, n)
        Of the cross-sections at the quadrature's points.
    lengths : (n_tendons,)
        [m].
    """

    of: TendonLengths
    tensions: Array
    strains: Array
    lengths: Array

    @property
    def crushed(self) -> CollapsedError | None:
        """What to tell of the first cross-section that leaves a tendon no length, if any."""
        at = self.of.at
        crushed = at.crushed(self.strains)
        if not crushed.any():
            return None
        i = int(np.argmax(crushed))
        stretch = 1 + reported(at.sections.law, self.strains[i : i + 1])[0, 3]
        return CollapsedError(float(at.sections.s[i]), float(stretch))

    @cached_property
    def length_tension(self) -> Array:
        """How the lengths change with the tensions (n_tendons, n_tendons) [m/N]."""
        at, v = self.of.at.sections, self.strains
        jacobian = at.length_jacobian(v, self.of.weights)[1].reshape(self.tensions.size, -1)
        stiffness = at.wrench(v, at.pulls(self.tensions))[1]
        return jacobian @ at.by_tensions(v, stiffness).reshape(jacobian.shape[1], -1)


class TendonLengths:
    """Tensions to lengths of the tendons, by Gauss quadrature in each step."""

    def __init__(self, arm: Arm, scene: Scene, machine_code: bool = False) -> None:
        mesh, method, scene = graded(arm, 1), gauss(_POINTS), unloaded(scene)
        h, law = np.diff(mesh.s), cross_section_of(scene, arm.is_curved, torsion=False)
        s, active = (mesh.s[:-1, None] + h[:, None] * method.c).ravel(), mesh.active
        self.weights = np.outer(h, method.b).ravel()
        self.at = UnloadedSections(arm, scene, law, s, np.repeat(active, _POINTS), machine_code)

    def __call__(self, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,); raises UnsettledSectionError."""
        v = self.at.strains(tensions)
        return Lengths(self, tensions, v, self.at.sections.lengths(v, self.weights))


@lru_cache(maxsize=48)
def tendon_lengths(arm: Arm, scene: Scene, machine_code: bool = False) -> TendonLengths:
    """Return the lengths of tendons by tensions; see TendonLengths."""
    return TendonLengths(arm, scene, machine_code)
