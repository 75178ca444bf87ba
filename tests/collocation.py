"""Shapes by collocation on a given mesh: an independent check of `settle`."""

from __future__ import annotations

from dataclasses import replace

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.loads import is_coupled
from octoplan.model.rod.discrete_rod import system
from tests.oracles import Array


def collocated(
    arm: Arm, tensions: Array, scene: Scene, stages: int = 3, refinement: int = 16
) -> Shape:
    """Return a shape by collocation with a number of stages, on the mesh of a refinement.

    Without loads `settle` solves each cross-section separately instead; under loads `settle` uses
    three stages.
    """
    T = arm.flat(tensions)
    equations = system(arm, scene, stages, refinement, (), is_coupled(arm, scene))
    point = CollocationMap(equations).solve(T)
    return replace(settle(arm, T, scene, 1e-2), equilibrium=point, refinement=refinement)
