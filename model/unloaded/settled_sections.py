"""Cross-sections that settle by themselves, under tensions alone: their strains."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.cross_section.law import CrossSection
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.effects import ExactTendons, Extension
from model.errors import UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.transcription.system import System
from model.unloaded.closed_form import SectionStrains
from model.unloaded.stretch import LEAST_STRETCH


class SettledSections:
    """The cross-sections of an arm at s (N,) that `active` (N,) anchorages' tendons cross.

    Attributes
    ----------
    by_the_paper : SectionStrains
        Their strains by the paper's balance.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        law: CrossSection,
        s: Array,
        active: Counts,
        machine_code: bool = False,
    ) -> None:
        self.arm, self.scene, self.active = arm, scene, active
        self.sections = Sections(arm, scene, law, s, active, machine_code)
        paper = Scene(Extension()) if law.extension else Scene()
        self.by_the_paper = SectionStrains(arm, paper, s, active)

    def strains(self, tensions: Array) -> Array:
        """Return their strains (N, n) under tensions (n_tendons,).

        Of an energy by Newton's method from those of the paper's balance; where that does not come
        to a minimum, by one that holds at any tension. Raises UnsettledSectionError.
        """
        sections = self.sections
        law, s = sections.law, sections.s
        found = strains_of(law, self.by_the_paper(tensions))
        if not self.scene.has(ExactTendons):
            return found
        found, lost = sections.at_rest(found, sections.pulls(tensions))
        if lost.any():
            left = SectionStrains(self.arm, self.scene, s[lost], self.active[lost])(tensions)
            if np.isnan(left).any():
                raise UnsettledSectionError(float(s[lost][np.isnan(left).any(axis=1)][0]))
            found[lost] = strains_of(law, left)
        return found

    def of_many(self, tensions: Array) -> Array:
        """Return their strains (M, N, n) under tensions (M, n_tendons); NaN where none are."""
        rows = self._many.of_many(tensions)
        found = strains_of(self.sections.law, rows.reshape(-1, rows.shape[-1]))
        return found.reshape(*rows.shape[:2], -1)

    @cached_property
    def _many(self) -> SectionStrains:
        form = self.sections
        return SectionStrains(self.arm, self.scene, form.s, self.active, form.machine_code)

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
