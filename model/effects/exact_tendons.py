"""Tendons as they are: a constant tension along a curve, with the potential T times its length."""

from __future__ import annotations

from dataclasses import field

from model.effects.base import Effect
from model.units import warn
from model.value import value


@value
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
        Deprecated, and without effect: cross-sections take as many Newton steps as they need.
    """

    robust: bool = field(default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.robust:
            told = "ExactTendons(robust=) has no effect: sections take the steps that they need"
            warn(told, DeprecationWarning)
