"""Contact of the arm with itself."""

from __future__ import annotations

from model.effects.base import Effect
from model.value import value


@value
class SelfContact(Effect):
    """Parts of the arm that meet press each other apart, without friction.

    The surface is that of balls of the arm's radius along its midline, as for clearances and
    contact: the gap between the places s1 < s2 is the distance of the midlines less both radii. Of
    places between which the arm has turned by half a turn, so that they are farther along than
    their own thickness, gap >= 0, force >= 0, gap times force = 0. The forces are equal and
    opposite, along the line that joins the midlines, at pairs of points where the gap is least. A
    neo-Hookean body swells where it is shortened; that it is squeezed where it presses is left out.

    `settle` states it, `Shape.contacts` has both forces of each pair. It goes with all statics and
    dead loads, but not with Contact, Friction or PrintedStatics; plans, stiffness, motions and
    tendons held by length do not state it and refuse it.
    """
