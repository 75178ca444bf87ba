"""The law of the cross-sections of a scene, and the numbers of the body in the law."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.energy import ExactSection, RubberSection
from octoplan.model.cross_section.law import CrossSection, PaperSection
from octoplan.model.effects.sections import ExactTendons, Extension, NeoHookean, Shear
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.stations import Stations


def cross_section_of(scene: Scene, curved: bool = False, twisted: bool = True) -> CrossSection:
    """Return the law of the cross-sections of a scene.

    Parameters
    ----------
    curved : bool
        Whether the cross-sections are curved at rest.
    twisted : bool
        Whether the law has torsion, and shear if the scene has Shear.
    """
    extension = scene.has(Extension)
    shear = twisted and scene.has(Shear)
    rubber = scene.find(NeoHookean)
    if rubber is not None:
        return RubberSection(extension, twisted, shear, curved, anticlastic=rubber.anticlastic)
    kind = ExactSection if scene.has(ExactTendons) else PaperSection
    return kind(extension, twisted, shear, curved)


def body_numbers(arm: Arm, scene: Scene, at: Stations, rates: bool = False) -> Array:
    """Return the numbers of the body (n, N), or the derivatives along s; see CrossSection."""
    rest = at.rest_rate if rates else at.rest
    body = arm.section_stiffness(at.s)[int(rates)]
    shear = scene.find(Shear)
    GA = body[0] * (shear.k_s * arm.material.G / arm.material.E if shear else 0.0)
    return np.vstack([body, GA, rest])
