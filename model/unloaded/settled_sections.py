"""Cross-sections that settle by themselves, under tensions alone: their strains."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.cross_section.law import CrossSection
from model.cross_section.reported import reported, strains_of
from model.cross_section.sections import Sections
from model.effects import ExactTendons
from model.errors import UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.transcription.system import System
from model.unloaded.section_solver import SectionSolver
from model.unloaded.stretch import LEAST_STRETCH


class SettledSections:
    """The cross-sections of an arm at s (N,) that `active` (N,) anchorages' tendons cross."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        law: CrossSection,
        s: Array,
        active: Counts,
        machine_code: bool = False,
    ) -> None:
        self.scene, self.sections = scene, Sections(arm, scene, law, s, active, machine_code)
        self._solver = SectionSolver(arm, scene, s, active, machine_code)

    def strains(self, tensions: Array) -> Array:
        """Return their strains (N, n) under tensions (n_tendons,).

        Raises UnsettledSectionError.
        """
        found = self._of_law(self._solver.strains(tensions))
        lost = np.isnan(found).any(axis=1)
        if lost.any():
            raise UnsettledSectionError(float(self.sections.s[np.argmax(lost)]))
        return found

    def of_many(self, tensions: Array) -> Array:
        """Return their strains (M, N, n) under tensions (M, n_tendons); NaN where none are."""
        rows = self._solver.of_many(tensions)
        return self._of_law(rows.reshape(-1, rows.shape[-1])).reshape(*rows.shape[:2], -1)

    def _of_law(self, v: Array) -> Array:
        """Return strains of the law, which may twist and shear sections, of those that do not."""
        law, plain = self.sections.law, self._solver.statics.law
        return v if law == plain else strains_of(law, reported(plain, v))

    def crushed(self, strains: Array) -> NDArray[np.bool_]:
        """Return where strains (N, n) leave a tendon no length (N,)."""
        sections = self.sections
        found = np.full(len(strains), False)
        if self.scene.has(ExactTendons):
            found[sections.place[sections.speeds(strains) <= LEAST_STRETCH]] = True
        return found


@lru_cache(maxsize=32)
def settled_sections(at: System) -> SettledSections:
    """Return the cross-sections at the stages of a system."""
    active = np.repeat(at.mesh.active, at.of.form.stages)
    form = at.of.form
    return SettledSections(at.arm, at.scene, form.law, at.s, active, form.machine_code)
