"""Shapes that errors are measured against: by collocation in scenes without loads.

`settle` solves each cross-section by itself in these scenes, so that collocation is a second way.
Under loads and as printed the reference is a settle to a finer accuracy.
"""

from __future__ import annotations

from dataclasses import replace

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import collocation_map
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array

# Refinement at which collocation leaves rounding.
_FINE = 96


def reference_shape(arm: Arm, tensions: Array, scene: Scene, accuracy: float) -> Shape:
    """Return the shape to an accuracy, by collocation on a fine mesh if the scene has no loads."""
    shape = settle(arm, tensions, scene, accuracy)
    if is_loaded(scene) or scene.has(PrintedStatics):
        return shape
    point = collocation_map(arm, scene, _FINE).solve(shape.tensions)
    return replace(shape, equilibrium=point, refinement=_FINE)
