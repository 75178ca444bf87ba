"""Reference shapes for the measurement of errors.

In scenes without loads the reference is a collocation solution, because `settle` uses another
method there: a separate solution of each cross-section. Under loads, and for the statics as
printed, the reference is `settle` with a finer accuracy.
"""

from __future__ import annotations

from dataclasses import replace

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import collocation_map
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array

# Refinement at which the error of collocation is at the level of rounding.
_FINE = 96


def reference_shape(arm: Arm, tensions: Array, scene: Scene, accuracy: float) -> Shape:
    """Return the reference shape with the given accuracy.

    Use collocation on a fine mesh if the scene has no loads.
    """
    shape = settle(arm, tensions, scene, accuracy)
    if is_coupled(arm, scene) or scene.has(PrintedStatics):
        return shape
    point = collocation_map(arm, scene, _FINE).solve(shape.tensions)
    return replace(shape, equilibrium=point, refinement=_FINE)
