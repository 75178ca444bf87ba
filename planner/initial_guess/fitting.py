"""First guesses fitted to what is wanted: least squares over the bends of the sections.

Where a target prescribes turns, directions or several points, each section's bend is as good as
given, but not in closed form: tendons of the sections beyond bend a section too, and there are many
ways to wind up. So some of very many drawn bends, those nearest to what is wanted, are driven to it
by least squares, all together, on the coarsest mesh, in a scene without loads whose strains are
closed forms. What is met in several ways is met by several of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.effects import Extension
from model.paths import Array
from model.scene import Scene
from planner.initial_guess.bend_coordinates import BendCoordinates, bend_coordinates
from planner.initial_guess.least_squares import least_squares
from planner.initial_guess.residuals import residuals
from planner.program.limits import Limits
from planner.targets.base import Target

# How many are drawn, and how many of those are fitted: the work of a step grows with the square of
# the number of bends, so many are affordable.
_DRAWN, _FITTED, _DIFFERENCES = 4000, 160, 1000
# Where sections shorten, some of those that bends do not bring there are squeezed as well.
_SQUEEZED = 30
# What is nearer is met but for the errors of the mesh; what is not may be a place to get stuck.
_MET = 3e-3
_SAME = 0.05


@dataclass(frozen=True, eq=False)
class Fitting:
    """Least squares over the bends of an arm, for targets in a scene without loads."""

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    bends: BendCoordinates
    machine_code: bool

    def gaps(self, points: Array) -> Array:
        """Return residuals of targets, and of a body that is crushed, at bends (m, n)."""
        asked = self.arm, self.scene, self.targets
        return residuals(*asked, self.bends.tensions(points), self.machine_code)

    def fit(self) -> tuple[Array, Array]:
        """Return bends (m, n) fitted from drawn ones; residuals (m,)."""
        drawn = self.bends.draw(_DRAWN)
        off = self.gaps(drawn)
        nearest = np.argsort(np.linalg.norm(off, axis=1), kind="stable")
        points = drawn[nearest[: max(4, min(_FITTED, _DIFFERENCES // self.bends.width))]]
        points, residual = least_squares(self.gaps, points)
        redundant = self.bends.width > off.shape[1] - 1 and bool((residual < _MET).any())
        if self.scene.has(Extension) and not redundant:
            points = self._squeezed(points, residual)
        return points, residual

    def _squeezed(self, points: Array, residual: Array) -> Array:
        """Return bends and squeezes (m, 3 n): what nearly meets the targets may do so squeezed.

        Residuals are brought up to date.
        """
        points = np.hstack([points, np.zeros((len(points), len(self.bends.sections)))])
        order = self.different(points, residual)
        near = [i for i in order if residual[i] >= _MET][:_SQUEEZED]
        if near:
            points[near], residual[near] = least_squares(self.gaps, points[near])
        return points

    def different(self, points: Array, residual: Array) -> list[int]:
        """Return which differ from those before: the cheapest that meet, then the nearest."""
        T, met = self.bends.tensions(points), residual < _MET
        order = np.lexsort([np.where(met, np.linalg.norm(T, axis=1), residual), ~met])
        T = T[order]
        same = _distances(T) <= _SAME * np.abs(T).max(axis=1, keepdims=True)
        kept = np.zeros(len(T), dtype=bool)
        for i in range(len(T)):
            kept[i] = not (same[i] & kept).any()
        return [int(i) for i in order[kept]]


def fitted(
    arm: Arm, scene: Scene, targets: tuple[Target, ...], limits: Limits, machine_code: bool
) -> list[Array]:
    """Return tensions (n_tendons,) fitted to targets: the cheapest that meet them first.

    Then those that come nearest.
    """
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    bends = bend_coordinates(arm, tendons, limits)
    fitting = Fitting(arm, scene, targets, bends, machine_code)
    points, residual = fitting.fit()
    return list(bends.tensions(points)[fitting.different(points, residual)])


def _distances(T: Array) -> Array:
    """Return the largest differences (m, m) between rows (m, n)."""
    found = np.zeros((len(T), len(T)))
    for column in T.T:
        np.maximum(found, np.abs(column[:, None] - column), out=found)
    return found
