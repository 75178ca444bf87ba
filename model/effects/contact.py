"""Contact with something rigid and with the arm itself, and friction of sliding tendons."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta

from octoplan.model.effects.base import Effect
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.support.quantities import NotNegative, Sign
from octoplan.model.support.value import value


@value
class Contact(Effect):
    """A rigid obstacle that the arm's surface may not enter, and that presses it back.

    The surface is that of balls of the arm's radius along its midline, as clearances have it: the
    gap at s is the distance of the midline from the obstacle less the radius. At each place gap
    >= 0, force >= 0, gap times force = 0 (Signorini's conditions). The force acts along the
    obstacle's normal through the midline: on a tapered arm it leans by the slope of the radius
    against the cross-section, and has no moment about it. A scene may have several contacts, with
    different obstacles; it adds torsion, moment, force and contact force at the nodes. A
    neo-Hookean body swells where it is shortened; that it is squeezed where it leans is left out.

    Friction is Coulomb's, in quasi-static steps: with N what presses at a place and d how far the
    midline there has slipped along the obstacle in the step before, either d = 0 and the friction
    is at most mu N, or it is mu N against d. So it takes a motion: `settle(..., near=before)` leads
    tensions in a straight line, in eight steps or more, from those of a shape that is known, such
    as one that touches nothing or one settled without friction; `plan(..., near=before)` finds such
    tensions. Points that roll are off by what they roll in a step. What more steps would change is
    no part of `Shape.error`: it falls about as steps do, but unevenly, by when in a step a touch
    begins, so that two of their numbers do not tell it. From eight steps to sixteen up to 5e-3 of
    the length was seen, from 64 to 128 1e-3; `Shape.remarks` has it. Settle shapes in between, each
    near the one before, to see it. Friction acts on the midline: its moment about it, of its size
    times the arm's radius, and that the arm may roll sideways, are left out. Where the arm lies
    along an obstacle the scene has to have Extension, without which forces along the arm between
    places that stick are undetermined; friction there is spread as the pressure is, and where
    sticking and slipping meet is known to a node.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    friction : float
        Coulomb's coefficient mu between arm and obstacle.
    """

    obstacle: Convex
    friction: NotNegative = 0.0

    @property
    def place(self) -> tuple[Any, ...]:
        """What tells its obstacle from others of its kind."""
        return tuple(self.obstacle.numbers.tolist())


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


@value
class Friction(Effect):
    """Coulomb friction: ``dT/ds = -direction mu T |d(c/|c|)/ds|`` from the motor to the anchorage.

    On a circular arc of angle theta, T(L) = T(0) exp(-mu theta) while pulling in. All tendons
    slide; where a section's tendons end, those that go on are bent sharply and lose exp(-mu
    angle) there. Adds to the paper's scene torsion, the moment at the nodes, the angle that each
    tendon has turned there, and the rates of the strains: the most expensive effect. Without it a
    tendon is as tight at its end as at its motor: at mu = 0.2 a bend of 180 degrees costs half the
    tension.

    Attributes
    ----------
    mu : float
        Coefficient of friction.
    direction : int or tuple of int
        1 while the motor pulls in, -1 while it pays out; one for all tendons or one for each.
    """

    mu: NotNegative
    direction: Sign | Annotated[tuple[Sign, ...], Meta(min_length=1)] = 1
