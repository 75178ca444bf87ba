"""Steady drag of a stream."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import Density, NotNegative, Velocity
from model.value import value


@value
class Current(Effect):
    """A steady stream pushes across the arm: ``rho C R |v_n| v_n`` per unit deformed length.

    v_n is the part of the stream's velocity that is normal to the arm's tangent t, so the load
    depends on the shape (Morison's drag term). Adds to the paper's scene torsion, and moment and
    force at the nodes, and couples the cross-sections in one system of equations.
    Without it an arm in flowing water
    stands as in still water: 0.1 m/s move the tips of the paper's figures by 12 to 18 mm.

    Attributes
    ----------
    velocity : (3,)
        Of the stream, in the base frame [m/s].
    density : float
        Of the fluid [kg/m3].
    coefficient : float
        Drag coefficient of a cylinder across the stream, about 1.1 at the Reynolds numbers of an
        arm in water.
    """

    velocity: Velocity
    density: Density = 1000.0
    coefficient: NotNegative = 1.1
