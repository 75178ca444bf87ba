"""Cross-sections other than the solid circle: tube, rectangle, and given stiffness."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from octoplan.model.anchorage import Material, Profile, annulus
from octoplan.model.paths import Array, LengthPath, Linear, Path
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text
from octoplan.model.support.value import unit, value

__all__ = ["Rectangle", "SectionStiffness", "Tube"]

# Terms of the series of the torsion constant: the rest is below 1e-12 of the sum.
_ODD = np.arange(1, 400, 2)

StiffnessPath = Annotated[Path, unit("N", description="[base, end], or samples")]
RigidityPath = Annotated[Path, unit("N m2", description="[base, end], or samples")]


def _checked(name: str, path: Path, s: Array, span: float) -> tuple[Array, Array]:
    """Return values and derivatives of a path; raise InputError with the name of the field."""
    try:
        return path.evaluate(s, span)[:2]
    except InputError as reason:
        raise InputError(f"{name}.s", reason.given, reason.allowed) from None


@value
class Tube(Profile):
    """A circular tube: A = pi (R^2 - r^2), J = pi (R^4 - r^4) / 4, I = 2 J.

    The arm's radius is the outer radius R. The wall keeps its shape: the cross-section of a bent
    tube does not become oval. The fluid of `Buoyancy` fills the tube.

    Attributes
    ----------
    inner : Path
        Inner radius r(s) on [0, L] [m], below the arm's radius.
    """

    inner: LengthPath

    # Fibres in uniaxial stress and shear of each annulus, as of the solid circle.
    has_rubber_law: ClassVar[bool] = True

    @property
    def paths(self) -> tuple[Path, ...]:
        """See Profile.paths."""
        return (self.inner,)

    def stiffness(self, material: Material, radius: Array, s: Array, span: float) -> Array:
        """See Profile.stiffness."""
        return annulus(material, radius, np.array(self.inner.evaluate(s, span)[:2]))

    def area(self, radius: Array, s: Array, span: float) -> Array:
        """See Profile.area."""
        return np.asarray(np.pi * (radius[0] ** 2 - self.inner.evaluate(s, span)[0] ** 2))

    def check(self, radius: Array, s: Array, span: float) -> None:
        """See Profile.check: the inner radius is from 0 to below the outer radius."""
        inner, _ = _checked("Tube.inner", self.inner, s, span)
        if inner.min() < 0:
            raise InputError("Tube.inner", float(inner.min()), "a number >= 0")
        worst = int(np.argmax(inner - radius[0]))
        if inner[worst] >= radius[0][worst]:
            allowed = f"below the arm's radius, {length_text(radius[0][worst])}"
            raise InputError(
                "Tube.inner", float(inner[worst]), f"{allowed} at s = {length_text(s[worst])}"
            )


@value
class Rectangle(Profile):
    """A solid rectangle: A = w h, J_n = w h^3 / 12, J_b = h w^3 / 12.

    I is the torsion constant of Saint-Venant's series. The arm's radius is the radius of a circle
    around the rectangle, by which clearance, contact and drag are computed; `circumscribed` returns
    the smallest.

    Attributes
    ----------
    width : Path
        Side w(s) along n on [0, L] [m].
    height : Path
        Side h(s) along b on [0, L] [m].
    """

    width: LengthPath
    height: LengthPath

    @property
    def paths(self) -> tuple[Path, ...]:
        """See Profile.paths."""
        return self.width, self.height

    def circumscribed(self) -> Linear:
        """Return the radius of a circle around the rectangle, exact at both ends.

        Raises InputError if the sides are not linear.
        """
        for name, path in (("width", self.width), ("height", self.height)):
            if not isinstance(path, Linear):
                raise InputError(f"Rectangle.{name}", path, "a Linear path")
        assert isinstance(self.width, Linear) and isinstance(self.height, Linear)
        # The diagonal of linear sides is convex, so that its chord is not below.
        return Linear(
            float(np.hypot(self.width.base, self.height.base)) / 2,
            float(np.hypot(self.width.end, self.height.end)) / 2,
        )

    def stiffness(self, material: Material, radius: Array, s: Array, span: float) -> Array:
        """See Profile.stiffness."""
        w, dw, _ = self.width.evaluate(s, span)
        h, dh, _ = self.height.evaluate(s, span)
        A = np.array([w * h, dw * h + w * dh])
        J_n = np.array([w * h**3, dw * h**3 + 3 * w * h**2 * dh]) / 12
        J_b = np.array([h * w**3, dh * w**3 + 3 * h * w**2 * dw]) / 12
        torsion = torsion_constant(np.array([w, dw]), np.array([h, dh]))
        E = material.E
        return np.stack([E * A, E * J_n, E * J_b, material.G * torsion], axis=1)

    def area(self, radius: Array, s: Array, span: float) -> Array:
        """See Profile.area."""
        return np.asarray(self.width.evaluate(s, span)[0] * self.height.evaluate(s, span)[0])

    def outline(self, radius: Array, s: Array, span: float, around: int) -> Array:
        """See Profile.outline: corners are points if `around` is a multiple of 8."""
        phi = 2 * np.pi * np.arange(around) / around
        square = np.column_stack([np.cos(phi), np.sin(phi)])
        square /= np.abs(square).max(axis=1, keepdims=True)
        sides = [path.evaluate(s, span)[0] / 2 for path in self.paths]
        return np.asarray(np.column_stack(sides)[:, None] * square)

    def check(self, radius: Array, s: Array, span: float) -> None:
        """See Profile.check: the sides are positive, the corners within the circle."""
        sides = []
        for name, path in (("width", self.width), ("height", self.height)):
            side, _ = _checked(f"Rectangle.{name}", path, s, span)
            if side.min() <= 0:
                raise InputError(f"Rectangle.{name}", float(side.min()), "above 0")
            sides.append(side)
        corner = np.hypot(*sides) / 2
        worst = int(np.argmax(corner - radius[0]))
        if corner[worst] > radius[0][worst] * (1 + 1e-9):
            allowed = f"at least half the diagonal, {length_text(corner[worst])}"
            raise InputError(
                "Arm.radius", float(radius[0][worst]), f"{allowed} at s = {length_text(s[worst])}"
            )

    def check_tendon(self, offset: Array, s: Array, span: float) -> None:
        """See Profile.check_tendon."""
        for name, axis, path, y in zip(
            ("width", "height"), "nb", self.paths, np.abs(offset), strict=True
        ):
            side = path.evaluate(s, span)[0]
            worst = int(np.argmax(2 * y - side))
            if 2 * y[worst] > side[worst] * (1 + 1e-9):
                allowed = f"at least twice the offset of its tendons along {axis}"
                place = f"{length_text(2 * y[worst])} at s = {length_text(s[worst])}"
                raise InputError(f"Rectangle.{name}", float(side[worst]), f"{allowed}, {place}")


def torsion_constant(width: Array, height: Array) -> Array:
    """Return the torsion constant of a rectangle [m4] and its derivative (2, N).

    `width`, `height` (2, N) are the sides [m] and their derivatives. With a the longer and b the
    shorter side, a b^3 / 3 (1 - 192 b / (pi^5 a) sum tanh(n pi a / 2 b) / n^5), n odd (S. P.
    Timoshenko and J. N. Goodier, Theory of Elasticity, section 109).
    """
    is_wide = width[0] >= height[0]
    a, da = np.where(is_wide, width, height)
    b, db = np.where(is_wide, height, width)
    ratio = a / b
    tanh = np.tanh(np.pi / 2 * _ODD[:, None] * ratio)
    total = (tanh / _ODD[:, None] ** 5).sum(axis=0)
    slope = (np.pi / 2 * (1 - tanh**2) / _ODD[:, None] ** 4).sum(axis=0)
    factor = (1 - 192 / np.pi**5 * total / ratio) / 3
    by_ratio = 64 / np.pi**5 * (total / ratio**2 - slope / ratio)
    change = factor * (da * b**3 + 3 * a * b**2 * db)
    return np.array([factor * a * b**3, change + a * b * by_ratio * (da * b - a * db)])


@value
class SectionStiffness(Profile):
    """The stiffness of a composite body, such as a backbone in a skin.

    The midline is the axis of the principal stiffnesses. Weight is the material's density times
    pi R^2: give the mean density. The arm's radius is used for clearance, contact and drag.

    Attributes
    ----------
    EA : Path
        Axial stiffness on [0, L] [N].
    EJn, EJb : Path
        Flexural stiffness about n and b [N m2].
    GI : Path
        Torsional stiffness [N m2].
    """

    EA: StiffnessPath
    EJn: RigidityPath
    EJb: RigidityPath
    GI: RigidityPath

    is_of_material: ClassVar[bool] = False

    @property
    def paths(self) -> tuple[Path, ...]:
        """See Profile.paths."""
        return self.EA, self.EJn, self.EJb, self.GI

    def stiffness(self, material: Material, radius: Array, s: Array, span: float) -> Array:
        """See Profile.stiffness."""
        return np.stack([np.array(path.evaluate(s, span)[:2]) for path in self.paths], axis=1)

    def check(self, radius: Array, s: Array, span: float) -> None:
        """See Profile.check: stiffness is positive."""
        for name, path in zip(("EA", "EJn", "EJb", "GI"), self.paths, strict=True):
            values, _ = _checked(f"SectionStiffness.{name}", path, s, span)
            if values.min() <= 0:
                raise InputError(f"SectionStiffness.{name}", float(values.min()), "above 0")
