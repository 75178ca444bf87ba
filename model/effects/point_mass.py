"""A mass fixed to the arm, such as a marker or a camera."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import ArcLength, Mass, Place
from model.value import value


@value
class PointMass(Effect):
    """The weight of a mass that a cross-section carries, off the midline; needs Weight.

    The force in the arm jumps by m g there, and the moment by (R o) x m g: o turns with the frame R
    of the cross-section. What fluid the mass displaces is left out. Adds a node at s to a scene
    with weight, and off the midline a moment there. Without it what the arm carries is not felt.

    Attributes
    ----------
    s : float
        From the base [m]; has to lie on the arm.
    mass : float
        [kg].
    offset : (3,)
        From the midline in the local frame (t, n, b) [m]; on it unless given.
    """

    s: ArcLength
    mass: Mass
    offset: Place | None = None
