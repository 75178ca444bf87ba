"""Friction of the tendons, which slide in the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from octoplan.model.effects.base import Effect
from octoplan.model.effects.sections import Shear
from octoplan.model.support.quantities import NotNegative, Sign
from octoplan.model.support.value import value

if TYPE_CHECKING:
    from octoplan.model.scene import Scene


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

    @property
    def couples_sections(self) -> bool:
        """See Effect."""
        return True

    def convergence_order(self, scene: Scene, order: int, derivatives: bool) -> int:
        """See Effect: the rate at which a tendon turns has a kink if a load bends the arm."""
        loads = (each for each in scene.effects if not isinstance(each, Friction | Shear))
        if any(load.couples_sections for load in loads):
            return min(order - 1, 1 if derivatives else 2)
        return order - 1
