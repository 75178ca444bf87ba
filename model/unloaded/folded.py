"""Cross-sections that bend so far that a tendon has no length left in them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.cross_section.choice import cross_section_of
from model.effects import ExactTendons
from model.loads import is_loaded
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.stations import crossing, stations, tendon_paths
from model.unloaded.settled_sections import SettledSections

# A linear section folds where T y^2 / E J >= 1 + q >= 1 - T / E A, so that both shares together are
# at least 1; a neo-Hookean one shortens and bends less. Lighter tensions are not looked at.
_LIGHT = 0.2


def folded(
    arm: Arm, scene: Scene, tensions: Array, refinement: int, machine_code: bool
) -> float | None:
    """Return where from the base [m] tensions (n_tendons,) [N] first leave a tendon no length.

    None where they do so nowhere, at both ends of each step of a mesh. Beyond, the body would be
    folded into itself. Only exact tendons without loads come to that: with loads such tensions are
    refused.
    """
    if not scene.has(ExactTendons) or is_loaded(scene):
        return None
    if float(tensions @ _leverage(arm)) < _LIGHT:
        return None
    sections = _sections(arm, scene, refinement, machine_code)
    crushed = sections.crushed(sections.strains(tensions))
    return float(sections.sections.s[np.argmax(crushed)]) if crushed.any() else None


@lru_cache(maxsize=32)
def _sections(arm: Arm, scene: Scene, refinement: int, machine_code: bool) -> SettledSections:
    """Return the cross-sections at both ends of each step of a mesh."""
    mesh, law = graded(arm, refinement), cross_section_of(scene, arm.is_curved)
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    return SettledSections(arm, scene, law, ends, np.repeat(mesh.active, 2), machine_code)


@lru_cache(maxsize=256)
def _leverage(arm: Arm) -> Array:
    """Return the most of y^2 / E J + 1 / E A along each tendon (n_tendons,) [1/N]."""
    mesh = graded(arm, 1)
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    at = stations(arm, ends, np.repeat(mesh.active, 2))
    place, tendon = np.nonzero(crossing(arm, at))
    y, most = tendon_paths(arm, at, place, tendon)[:2], np.zeros(arm.n_tendons)
    share = (y**2).sum(axis=0) / at.body[1, place] + 1 / at.body[0, place]
    np.maximum.at(most, tendon, share)
    return most
