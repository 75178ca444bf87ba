"""Dry friction of the tendons in their sheaths."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from model.effects.base import Effect
from model.quantities import NotNegative, Sign
from model.value import value


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
