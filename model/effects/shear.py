"""Shear of the cross-sections."""

from __future__ import annotations

from model.effects.base import Effect
from model.quantities import Positive
from model.value import value


@value
class Shear(Effect):
    """Sections slide against each other: nu gains (F_n, F_b) / (G A k_s).

    F is the force in the body, tendons included. The two shears are strains of their own; as
    tendons pull sideways where they converge, the arm may be twisted as well. Without it a short,
    thick arm is too stiff across: by 3 EJ / (k_s G A L2) of its deflection, 0.2 % for table 2.

    Attributes
    ----------
    k_s : float
        Shear correction factor.
    """

    k_s: Positive = 1.0
