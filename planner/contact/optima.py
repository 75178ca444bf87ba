"""Local optima of plans in contact: which is best, and whether two starts agree on it."""

from __future__ import annotations

from dataclasses import dataclass

from planner.contact.load_path import LoadPath
from planner.contact.program import Optimum

# Efforts of optima that are one: starts are enough where two lead there. The residual of what steps
# left at an edge that is none.
_SAME, _EDGE = 1e-3, 1e-4


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """An optimum.

    Attributes
    ----------
    optimum : Optimum
    load_path : LoadPath
        To where its steps began.
    floor : float or None
        The least stability it was held to beside the margin, if it was.
    """

    optimum: Optimum
    load_path: LoadPath
    floor: float | None = None

    def load_paths(self) -> list[LoadPath]:
        """Return load paths to the optimum: from rest alone, then by more and more of the steps."""
        steps = [tuple(T.tolist()) for T in self.optimum.steps]
        parts = [steps[:: len(steps) // 2**n] for n in range(len(steps).bit_length())]
        return [(), self.load_path, *((*self.load_path, *part[1:]) for part in parts)]


def met(found: list[LocalOptimum], accuracy: float) -> list[LocalOptimum]:
    """Return those that meet the targets."""
    return [own for own in found if own.optimum.lacks < accuracy]


def agree(found: list[LocalOptimum], accuracy: float) -> bool:
    """Return whether two starts led to one optimum, the best so far."""
    own = [own.optimum for own in met(found, accuracy)]
    efforts = sorted(optimum.effort for optimum in own if optimum.kkt < _EDGE)
    return len(efforts) > 1 and efforts[1] <= efforts[0] * (1 + _SAME)


def best_of(found: list[LocalOptimum], accuracy: float) -> LocalOptimum | None:
    """Return the optimum of least effort of those that meet the targets, else the nearest.

    Before those where steps ended at an edge beyond which the arm jumps.
    """
    if own := met(found, accuracy):
        return min(own, key=lambda one: (one.optimum.kkt > _EDGE, one.optimum.effort))
    return min(found, key=lambda one: one.optimum.lacks, default=None)
