"""A force and a moment at the tip."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import Force, Moment
from model.value import value


@value
class TipLoad(Effect):
    """A force and a moment on the tip: dead in the base frame, or following the tip.

    F(L) = force and M(L) = moment, in the base frame or, with `follower`, in the tip's (boundary
    conditions of F' = -f, M' = -u' x F). Adds to the paper's scene torsion and the moment at the
    nodes, a follower the force there as well. Without it a payload is not felt: 2 mN (0.2 g) move
    the tips of the paper's figures by 5 to 10 mm.

    Attributes
    ----------
    force : (3,)
        [N].
    moment : (3,)
        [N m].
    follower : bool
        Whether force and moment turn with the tip frame (t, n, b).
    """

    force: Force = (0.0, 0.0, 0.0)
    moment: Moment = (0.0, 0.0, 0.0)
    follower: bool = False
