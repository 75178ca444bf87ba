"""Annotations of quantities: types, bounds, and units in files.

Values are stored in SI units, and bounds are in SI units. `octoplan.planner.frontends.io` derives
keys, checks, schema and documentation of files from the annotations, so that each argument is
defined once, in its class.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from msgspec import Meta

from octoplan.model.paths import Path
from octoplan.model.support.checks import SUCH, orthonormal, unit_vector
from octoplan.model.support.value import Rule


def unit(name: str, **bounds: Any) -> Meta:
    """Return the annotation of a quantity: its unit in files, and other arguments of Meta."""
    return Meta(extra={"unit": name}, **bounds)


Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Sign = Literal[1, -1]
Count = Annotated[int, Meta(ge=0)]
Corners = Annotated[tuple[int, ...], Meta(min_length=3, max_length=3)]
Vector = Annotated[tuple[float, ...], Meta(min_length=3, max_length=3)]
Direction = Annotated[Vector, Rule(unit_vector)]
Matrix = Annotated[tuple[Vector, ...], Meta(min_length=3, max_length=3)]
Frame = Annotated[Matrix, Rule(orthonormal)]
Axes = Annotated[Matrix, Rule(partial(orthonormal, right_handed=False))]
SUCH[Sign] = "1 (pulling in) or -1 (paying out)"

Length = Annotated[Positive, unit("mm")]
ArcLength = Annotated[NotNegative, unit("mm")]
Guides = Annotated[tuple[ArcLength, ...], Meta(max_length=1000)]
Place = Annotated[Vector, unit("mm")]
Sizes = Annotated[tuple[Positive, ...], unit("mm", min_length=3, max_length=3)]
# Descriptions of functions of arc length in files.
_PATH = "[base, end], or samples"
_PATHS = f"{_PATH}, or a list with one for each tendon"
LengthPath = Annotated[Path, unit("mm", description=_PATH)]
LengthPaths = Annotated[Path | tuple[Path, ...], unit("mm", description=_PATHS)]
AnglePaths = Annotated[Path | tuple[Path, ...], unit("deg", description=_PATHS)]
CurvaturePath = Annotated[Path, unit("1/m", description=_PATH)]
Angle = Annotated[float, unit("deg")]
Density = Annotated[NotNegative, unit("kg/m3")]
Force = Annotated[Vector, unit("N")]
# Axial stiffness E A of tendons whose lengths are held.
Tension = Annotated[Positive, unit("N")]
Stiffness = Annotated[Positive, unit("N/m")]
