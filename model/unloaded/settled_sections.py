"""Cross-sections that settle by themselves, under tensions alone: their strains."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.effects import ExactTendons, Extension
from model.errors import UnsettledSectionError
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.unloaded.closed_form import unloaded_strains


def settled_sections(
    arm: Arm, scene: Scene, sections: Sections, active: Counts, tensions: Array
) -> Array:
    """Return the strains (N, n) of cross-sections that `active` (N,) anchorages' tendons cross.

    Of an energy by Newton's method from those of the paper's balance; where that does not come to a
    minimum, by one that holds at any tension. Raises UnsettledSectionError.
    """
    law, s = sections.law, sections.s
    paper = Scene(Extension()) if law.extension else Scene()
    found = strains_of(law, unloaded_strains(arm, paper, s, active, tensions))
    if not scene.has(ExactTendons):
        return found
    found, lost = sections.at_rest(found, sections.pulls(tensions))
    if lost.any():
        left = unloaded_strains(arm, scene, s[lost], active[lost], tensions)
        if np.isnan(left).any():
            raise UnsettledSectionError(float(s[lost][np.isnan(left).any(axis=1)][0]))
        found[lost] = strains_of(law, left)
    return found
