"""The shape of an arm at rest."""

from __future__ import annotations

from model.paths import Linear
from model.quantities import CurvaturePath
from model.value import value

STRAIGHT = Linear(0.0, 0.0)


@value
class RestCurvature:
    """Curvature of the midline without tensions and loads, as functions of arc length.

    The body resists what curvature differs from it by: K (omega - omega_0) in eq. (7). It turns no
    frame about t, so that a curve in space is one whose curvature changes its direction.

    Attributes
    ----------
    n, b : Path
        About n and about b on [0, L] [1/m]; 0 unless given. An arm bent towards n alone has a
        positive curvature about b, one bent towards b a negative one about n.
    """

    n: CurvaturePath = STRAIGHT
    b: CurvaturePath = STRAIGHT
