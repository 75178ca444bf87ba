"""Weight and buoyancy: dead loads spread along the arm."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import Acceleration, Density
from model.value import value


@value
class Weight(Effect):
    """The arm's own weight, rho A(s) g per unit reference length, with the material's density.

    F(s) is the weight of what lies beyond s, M' = -u' x F. Adds to the paper's scene torsion and
    the moment at the nodes, and couples the cross-sections in one system of equations. Without it
    the tip of table 2 under figure 11(b) is 4 cm off even in water, and half an arm's length in
    air.

    Attributes
    ----------
    g : (3,)
        Acceleration of gravity in the base frame [m/s2].
    """

    g: Acceleration = (0.0, 0.0, -9.81)


@value
class Buoyancy(Effect):
    """The weight of the fluid that the arm displaces, taken off: (rho - rho_fluid) A(s) g.

    Needs Weight, whose g it acts against; adds no state, unknown or time to it. Without it an arm
    in water hangs like one in air, 13 times too heavy for the silicone of the paper.

    Attributes
    ----------
    density : float
        Of the fluid [kg/m3].
    """

    density: Density = 1000.0
