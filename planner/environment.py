"""Environments: the bodies that an arm keeps clear of, as one value."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from octoplan.model.extensions.obstacles import Moving, Obstacle


@dataclass(frozen=True)
class Environment:
    """The bodies that an arm keeps clear of.

    Attributes
    ----------
    obstacles : tuple of Obstacle
    clearance : float
        Smallest allowed distance between the arm's surface and the bodies [m].
    of_itself : bool
        Whether the arm keeps the same distance from itself and from the far side of its base plane.
    moving : tuple of Moving
        Moving obstacles, of motions.
    """

    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.0
    of_itself: bool = False
    moving: tuple[Moving, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.obstacles) or self.of_itself or bool(self.moving)

    def at(self, t: float) -> Environment:
        """Return the environment at a time [s], with every obstacle at rest."""
        placed = tuple(obstacle.at(t) for obstacle in self.moving)
        return replace(self, obstacles=self.obstacles + placed, moving=())

    @property
    def keywords(self) -> dict[str, Any]:
        """The obstacles at rest and the clearance as keywords of `plan`."""
        return {
            "obstacles": self.obstacles,
            "clearance": self.clearance if self.obstacles or self.of_itself else 0.0,
            "self_clearance": self.of_itself,
        }


NOTHING = Environment()
