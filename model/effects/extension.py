"""Longitudinal strain."""

from __future__ import annotations

from model.effects.base import Effect
from model.value import value


@value
class Extension(Effect):
    """The arm shortens under its tendons: E A q = t . (-sum T c + F), eqs. (3b) and (9a).

    Adds no state: q follows from the curvatures in one step. Without it q = 0, which moves the tip
    of the paper's fetches by 65 to 92 mm out of 450.
    """
