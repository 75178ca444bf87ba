"""Statics of cross-sections: extension, shear, exact tendons, and the neo-Hookean body."""

from __future__ import annotations

from typing import TYPE_CHECKING

from octoplan.model.arm import Arm
from octoplan.model.effects.base import Effect, EffectSet, Rules
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import Positive, value

if TYPE_CHECKING:
    from octoplan.model.rod.rod_term import RodTerm


@value
class Extension(Effect):
    """The arm shortens under its tendons: E A q = t . (-sum T c + F), eqs. (3b) and (9a).

    Adds no state: q follows from the curvatures in one step. An inextensible arm (q = 0) differs by
    65 to 92 mm out of 450 at the tip in the fetches of the paper.
    """


@value
class ExactTendons(Effect):
    """Moment and force balance with the unit tangent of the tendon, ``c / |c|``.

    Per unit reference length nu = (1 + q) t, kappa = (1 + q) omega, c = nu + y' d + y kappa x d,
    and the section settles where the body's energy plus the sum of ``T |c|`` is stationary, in
    place of the paper's balance with the reference tangent, eqs. (8) and (9).

    Adds no state: without loads the curvatures and q follow from a small convex problem in each
    cross-section, solved by Newton's method. With the reference tangent, the moment of a tendon
    grows less than in proportion as the arm curls up, by the term y^2 T: the tip differs by 106 and
    182 mm out of 450 in the fetches of the paper. `python -m studies.speed effects` measures the
    computing time.
    """


@value
class NeoHookean(Effect):
    """Neo-Hookean body of constant volume; needs Extension and ExactTendons.

    With lambda = 1 + q the section and the tendon offsets shrink by lambda^(-1/2). Energy per unit
    reference length: EA (lambda^2 + 2/lambda - 3) / 6 + EJ (1 + 2 lambda^-3) / (6 lambda) times the
    curvature squared, plus the sum of ``T |c|`` with the shrunken offsets.

    Adds no state. Compared with finite elements, the tip of a soft arm that bends by 94 degrees is
    off by 0.4 % of its length, and by 5 % with the linear body.

    Attributes
    ----------
    anticlastic : bool
        Whether the cross-section swells on the inside of a bend and shifts its tendons: the
        component of the tangent along the arm becomes
        lambda - lambda^(-1/2) g.Y - lambda^-2 ((g.Y)^2 - (g x Y)^2) / 4
        with g = (kappa_b, -kappa_n) and Y = y d.
    """

    anticlastic: bool = False

    @classmethod
    def needs(cls) -> Rules:
        """See Effect."""
        return (
            ("Extension", "the body shortens at constant volume"),
            ("ExactTendons", "its section is the stationary point of an energy"),
        )

    def check_arm(self, arm: Arm) -> None:
        """See Effect: the energy is derived for the solid circle and for tubes."""
        if not arm.profile.has_rubber_law:
            allowed = "a Tube or the solid circle with NeoHookean, which is derived for these"
            raise InputError("Arm.cross_section", arm.cross_section, allowed)


@value
class Shear(Effect):
    """Sections slide against each other: nu gains (F_n, F_b) / (G A k_s).

    F is the force in the body, tendons included. The two shears are additional strains. Converging
    tendons pull sideways, so that the arm may be twisted as well. Without shear the deflection of a
    thick arm is too small by the fraction 3 EJ / (k_s G A L^2), 0.2 % for table 2.

    Attributes
    ----------
    k_s : float
        Shear correction factor.
    """

    k_s: Positive = 1.0

    def check_arm(self, arm: Arm) -> None:
        """See Effect: the shear stiffness is that of the arm's material."""
        if not arm.profile.is_of_material:
            allowed = "a Tube, a Rectangle or the solid circle with Shear, which needs the area"
            raise InputError("Arm.cross_section", arm.cross_section, allowed)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return a term that couples the cross-sections; shear itself is part of their law."""
        from octoplan.model.rod.load_terms import CouplingTerm

        return CouplingTerm()
