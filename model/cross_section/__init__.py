"""Laws of a cross-section, one file each: strains to the wrench that body and tendons balance."""

from __future__ import annotations

from octoplan.model.cross_section.energy import ExactSection, RubberSection
from octoplan.model.cross_section.law import CrossSection, PaperSection
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, Shear
from octoplan.model.scene import Scene

__all__ = ["CrossSection", "cross_section_of"]


def cross_section_of(scene: Scene, curved: bool = False, twisted: bool = True) -> CrossSection:
    """Return the law of a scene's cross-sections; unless they are `twisted` without torsion, shear.

    `curved` says whether they are curved at rest.
    """
    shape = (scene.has(Extension), twisted, twisted and scene.has(Shear), curved)
    rubber = scene.find(NeoHookean)
    if rubber is not None:
        return RubberSection(*shape, anticlastic=rubber.anticlastic)
    return ExactSection(*shape) if scene.has(ExactTendons) else PaperSection(*shape)
