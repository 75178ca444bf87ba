"""The paper's differential equations and jumps to the letter."""

from __future__ import annotations

from model.effects.base import Effect
from model.value import value


@value
class PrintedStatics(Effect):
    """Equations (10) and (11) exactly as printed, for reproducing the paper and nothing else.

    They leave out the turning of the frame, omega x K omega, and add the share of an anchorage's
    own tendons to the curvature as if no other tendon crossed the section. Adds the torsion tau as
    a state, and has no closed form. Stated for tendons on the axes n, b, -n, -b only.
    """
