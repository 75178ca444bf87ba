"""The law of a scene's cross-sections, and the numbers that the law takes of the body."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.energy import ExactSection, RubberSection
from octoplan.model.cross_section.law import CrossSection, PaperSection
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, Shear
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.stations import Stations, resists


def cross_section_of(scene: Scene, curved: bool = False, twisted: bool = True) -> CrossSection:
    """Return the law of a scene's cross-sections; unless they are `twisted` without torsion, shear.

    `curved` says whether they are curved at rest.
    """
    shape = (scene.has(Extension), twisted, twisted and scene.has(Shear), curved)
    rubber = scene.find(NeoHookean)
    if rubber is not None:
        return RubberSection(*shape, anticlastic=rubber.anticlastic)
    return ExactSection(*shape) if scene.has(ExactTendons) else PaperSection(*shape)


def body_numbers(arm: Arm, scene: Scene, at: Stations, rates: bool = False) -> Array:
    """Return what laws take of the body (n, N), or its derivatives along s; see CrossSection."""
    area, rest = (at.area_rate, at.rest_rate) if rates else (at.area, at.rest)
    body = resists(arm.material, area)
    shear = scene.find(Shear)
    GA = body[0] * (shear.k_s * arm.material.G / arm.material.E if shear else 0.0)
    return np.vstack([body, GA, rest])
