"""Tendons as they are: a constant tension along a curve, with the potential T times its length."""

from __future__ import annotations

from dataclasses import dataclass

from model.effects.base import Effect
from model.errors import InputError


@dataclass(frozen=True)
class ExactTendons(Effect):
    """Moment and force balance with the unit tangent of the tendon, ``c / |c|``.

    Per unit reference length nu = (1 + q) t, kappa = (1 + q) omega, c = nu + y' d + y kappa x d,
    and the section settles where the body's energy plus the sum of ``T |c|`` is stationary, in
    place of the paper's balance with the reference tangent, eqs. (8) and (9).

    Adds no state: without loads the curvatures and q follow from a small convex problem in each
    cross-section, solved by Newton's method: a settle takes 13 times as long (figure 15). Without
    it the moment of a tendon grows less than in proportion as the arm curls up, by the term y2 T:
    on the paper's fetches the tip moves by 106 and 182 mm out of 450.

    Attributes
    ----------
    robust : bool
        Whether sections settle by forty Newton steps in place of ten. `settle` sees by itself where
        that is needed: a neo-Hookean body under ten times the tension that curls it up.
    """

    robust: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.robust, bool):
            raise InputError("ExactTendons.robust", self.robust, "True or False")
