"""Dry friction of the tendons in their sheaths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.checks import finite_array, not_negative
from model.effects.base import Effect
from model.errors import InputError
from model.quantities import NotNegative, Sign


@dataclass(frozen=True)
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
    direction: Sign | tuple[Sign, ...] = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "mu", not_negative("Friction.mu", self.mu))
        one = isinstance(self.direction, int)
        given = (self.direction,) if one else self.direction
        signs = finite_array("Friction.direction", given, (None,))
        if signs.size == 0 or not np.all(np.isin(signs, (-1, 1))):
            allowed = "1 (pulling in) or -1 (paying out), for all tendons or for each"
            raise InputError("Friction.direction", self.direction, allowed)
        kept = tuple(int(sign) for sign in signs)
        object.__setattr__(self, "direction", kept[0] if one else kept)
