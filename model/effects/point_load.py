"""A force somewhere along the arm."""

from __future__ import annotations

from dataclasses import dataclass

from model.checks import not_negative, vector
from model.effects.base import Effect
from model.quantities import ArcLength, Force


@dataclass(frozen=True)
class PointLoad(Effect):
    """A dead force on the midline at arc length s; a scene may have several, at different places.

    The force in the arm jumps there, F(s-) = F(s+) + force, the moment does not. Adds to the
    paper's scene torsion, the moment at the nodes, and a node at s. Without it what the arm leans
    on is not felt.

    Attributes
    ----------
    s : float
        From the base [m]; has to lie on the arm.
    force : (3,)
        In the base frame [N].
    """

    s: ArcLength
    force: Force

    def __post_init__(self) -> None:
        object.__setattr__(self, "s", not_negative("PointLoad.s", self.s))
        object.__setattr__(self, "force", vector("PointLoad.force", self.force))
