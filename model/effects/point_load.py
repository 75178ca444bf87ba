"""A force somewhere along the arm."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import ArcLength, Force
from model.value import value


@value
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
