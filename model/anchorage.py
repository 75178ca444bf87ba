"""The parts of an arm: material, curvature at rest, cross-section, and anchorages of tendons."""

from __future__ import annotations

from itertools import chain, pairwise
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from octoplan.model.paths import SAME, AnglePaths, Array, CurvaturePath, LengthPaths, Linear, Path
from octoplan.model.support.checks import SUCH
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.text import counted
from octoplan.model.support.units import (
    ANGLE_AROUND,
    DENSITY,
    MODULUS,
    TURN,
    length_text,
    warn_unusual,
)
from octoplan.model.support.value import Angle, Guides, Length, Positive, unit, value

# The angles of the paper's four tendons, along n, b, -n and -b [rad].
QUARTERS = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


@value
class Anchorage:
    """The cross-section at which tendons end, and the paths of these tendons from the base.

    Attributes
    ----------
    at : float
        Arc length l_i of the section from the base [m].
    offset : Path, or a tuple with one for each tendon
        Distance y_i(s) of the tendons from the midline on [0, l_i] [m]; eq. (5) is `Linear(a, b)`.
    angles : tuple of float
        Angle phi of each tendon, with the direction d = cos(phi) n + sin(phi) b [rad]. The default
        is the paper's four tendons j = 1..4 along n, b, -n, -b.
    turn : Path, or a tuple with one for each tendon
        Additional angle along the arm [rad], 0 by default. Tendons that turn twist the arm.
    guides : tuple of float
        Arc lengths of spacer discs between the base and the anchorage [m]: the tendons run straight
        from guide to guide, at the offsets of their paths there. Base and anchorage are guides. The
        default None assumes a continuous guide, such as a channel in the body. An empty tuple has
        one straight span. Guides are rigid. In a scene with Friction they follow the
        capstan law.

    Raises
    ------
    InputError
        If guides are not between base and anchorage, coincide, or do not increase; and for other
        fields that are not allowed.
    """

    at: Length
    offset: LengthPaths
    angles: Annotated[tuple[Angle, ...], Meta(min_length=1)] = QUARTERS
    turn: AnglePaths | None = None
    guides: Guides | None = None

    def __post_init__(self) -> None:
        for k, (before, after) in enumerate(pairwise((0.0, *(self.guides or ()), self.at))):
            if after - before > SAME * self.at:
                continue
            # The anchorage is the end of the last span; the last guide is then too far.
            i = min(k, len(self.guides or ()) - 1)
            allowed = (
                f"increasing arc lengths between the base and the anchorage at "
                f"{length_text(self.at)}, which are guides themselves"
            )
            raise InputError(f"Anchorage.guides[{i}]", (self.guides or ())[i], allowed)
        warn_unusual("Anchorage.angles", self.angles, ANGLE_AROUND)
        for name, each in (("offset", self.offset), ("turn", self.turn)):
            if isinstance(each, tuple) and len(each) != len(self.angles):
                allowed = f"{len(self.angles)} paths, one for each tendon"
                given = Described(counted(len(each), "path"))
                raise InputError(f"Anchorage.{name}", given, allowed)
        turns = self.turn if isinstance(self.turn, tuple) else (self.turn,)
        ends = [(path.base, path.end) for path in turns if isinstance(path, Linear)]
        warn_unusual("Anchorage.turn", chain.from_iterable(ends), TURN)

    @property
    def offsets(self) -> tuple[Path, ...]:
        """The offset of each tendon."""
        return self._each(self.offset)

    @property
    def angle_paths(self) -> tuple[Path | None, ...]:
        """The additional angle of each tendon, None for tendons that do not turn."""
        return (None,) * len(self.angles) if self.turn is None else self._each(self.turn)

    @property
    def paths(self) -> tuple[Path, ...]:
        """All given paths."""
        arguments = (self.offset, self.turn)
        rows = [each if isinstance(each, tuple) else (each,) for each in arguments]
        return tuple(path for row in rows for path in row if path is not None)

    def _each(self, argument: Path | tuple[Path, ...]) -> tuple[Path, ...]:
        return argument if isinstance(argument, tuple) else (argument,) * len(self.angles)


# No curvature at rest.
STRAIGHT = Linear(0.0, 0.0)


@value
class RestCurvature:
    """Curvature of the midline without tensions and loads, as functions of arc length.

    The body resists the difference from this curvature, K (omega - omega_0) in eq. (7). There is no
    torsion at rest: the direction of the curvature varies along a curve in space.

    Attributes
    ----------
    n, b : Path
        About n and about b on [0, L] [1/m], 0 by default. An arm that is bent towards n has a
        positive curvature about b; an arm that is bent towards b has a negative curvature about n.
    """

    n: CurvaturePath = STRAIGHT
    b: CurvaturePath = STRAIGHT


@value
class Material:
    """An isotropic elastic material; the default is the silicone of tables 2 and 4.

    Attributes
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio, in (-1, 0.5].
    density : float
        [kg/m3].
    """

    E: Annotated[Positive, unit("kPa")] = 110e3
    nu: Annotated[float, Meta(gt=-1, le=0.5)] = 0.5
    density: Annotated[Positive, unit("kg/m3")] = 1080.0

    def __post_init__(self) -> None:
        warn_unusual("Material.E", [self.E], MODULUS)
        warn_unusual("Material.density", [self.density], DENSITY)

    @property
    def G(self) -> float:
        """Shear modulus E / (2 (1 + nu)) [Pa]."""
        return self.E / (2 * (1 + self.nu))


@value
class Profile:
    """The shape of the cross-sections of an arm, within the circle of the arm's radius.

    `radius` (2, N) are the radius R(s) [m] of this circle and its derivative.
    """

    # Whether the neo-Hookean energy is derived for this shape.
    has_rubber_law: ClassVar[bool] = False
    # Whether the cross-section is of the arm's material, so that shear stiffness is k_s G A.
    is_of_material: ClassVar[bool] = True

    @property
    def paths(self) -> tuple[Path, ...]:
        """The functions of arc length."""
        return ()

    def stiffness(self, material: Material, radius: Array, s: Array, span: float) -> Array:
        """Return E A [N], E J_n, E J_b, G I [N m2] and their derivatives along s (2, 4, N)."""
        raise NotImplementedError

    def area(self, radius: Array, s: Array, span: float) -> Array:
        """Return the area (N,) of the material [m2]."""
        return np.asarray(np.pi * radius[0] ** 2)

    def outline(self, radius: Array, s: Array, span: float, around: int) -> Array:
        """Return points (N, around, 2) of the outline along n and b [m]."""
        phi = 2 * np.pi * np.arange(around) / around
        circle = np.column_stack([np.cos(phi), np.sin(phi)])
        return np.asarray(radius[0][:, None, None] * circle)

    def check(self, radius: Array, s: Array, span: float) -> None:
        """Raise InputError if the shape is not within the circle, or degenerate."""

    def check_tendon(self, offset: Array, s: Array, span: float) -> None:
        """Raise InputError if a tendon at offsets (2, N) along n and b [m] is outside."""


SUCH[Profile] = "a Tube, a Rectangle or a SectionStiffness"


@value
class Solid(Profile):
    """The solid circle, eq. (7)."""

    has_rubber_law: ClassVar[bool] = True

    def stiffness(self, material: Material, radius: Array, s: Array, span: float) -> Array:
        """See Profile.stiffness."""
        return annulus(material, radius, np.zeros_like(radius))


def annulus(material: Material, outer: Array, inner: Array) -> Array:
    """Return the stiffness (2, 4, N) of an annulus; radii (2, N) with derivatives."""
    (R, dR), (r, dr) = outer, inner
    A = np.array([np.pi * (R**2 - r**2), 2 * np.pi * (R * dR - r * dr)])
    J = np.array([np.pi * (R**4 - r**4) / 4, np.pi * (R**3 * dR - r**3 * dr)])
    EJ = material.E * J
    return np.stack([material.E * A, EJ, EJ, 2 * material.G * J], axis=1)
