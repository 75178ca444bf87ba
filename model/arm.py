"""The arm: a tapered body, its material, and the tendons anchored along it. Numbers only."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from octoplan.model.anchorage import Anchorage, Material, Profile, RestCurvature, Solid
from octoplan.model.paths import Array, LengthPath, Linear, Path
from octoplan.model.support.checks import (
    LARGEST,
    SMALLEST,
    is_several,
    numbers,
    numbers_text,
    whole,
)
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.text import HtmlRepr, columns, counted, ends_text, shortened_lines
from octoplan.model.support.units import (
    LENGTH,
    PLASTICS,
    RADIUS,
    STIFF,
    STIFF_PLASTIC,
    length_text,
    stiff_text,
    warn_unusual,
)
from octoplan.model.support.value import Frame, Length, Place, value

Row = tuple[float, float, float]

# The paper's arms: length [m], radii of base and tip [m], rows (l_i, a_i, b_i) from tip to base.
PAPER_ARMS: dict[str, tuple[float, tuple[float, float], list[Row]]] = {
    "table-2": (
        0.310,
        (15e-3, 6.5e-3),
        [(0.310, 7.5e-3, 1e-3), (0.217, 3.5e-3, 3.5e-3), (0.093, 6e-3, 6e-3)],
    ),
    "table-4": (
        0.450,
        (15e-3, 2e-3),
        [(0.450, 7.5e-3, 1e-3), (0.315, 3.5e-3, 3.5e-3), (0.135, 6e-3, 6e-3)],
    ),
    "section-5.1": (0.300, (10e-3, 1.5e-3), [(0.300, 0.66e-3, 1e-3)]),
    "section-5.2": (0.270, (15e-3, 7.4e-3), [(0.270, 5e-3, 2.5e-3)]),
}

# The paper's base frame by rows: t along x, n along -y, b along -z.
PAPER_FRAME = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))


# The default shape of cross-sections.
SOLID = Solid()


def _evaluated(field: str, path: Path, s: Array, span: float) -> Array:
    """Return the values of a path of an arm (n,); raise InputError with the name of the field."""
    try:
        return path.evaluate(s, span)[0]
    except InputError as reason:
        raise InputError(f"{field}.s", reason.given, reason.allowed) from None


@value
class Arm(HtmlRepr):
    """A tendon-driven arm, clamped at its base.

    Attributes
    ----------
    length : float
        L [m].
    radius : Path
        Radius R(s) of the round body, or of a circle around another body, on [0, L] [m]; eq. (7)
        is `Linear(R_max, R_min)`.
    sections : tuple of Anchorage
        From the tip to the base: section 1 is the section nearest to the tip.
    material : Material
    base_frame : 3x3 nested tuple
        Columns t, n, b of the base; the default is the paper's frame.
    base_position : tuple of three floats
        [m].
    hull : Path
        Radius within which tendons run [m], if discs guide the tendons outside of the body. The
        default is the radius of the body.
    rest_curvature : RestCurvature
        Curvature of the arm without tensions and loads. The default is a straight arm.
    cross_section : Tube, Rectangle or SectionStiffness
        Shape or stiffness of the cross-sections. The default is the solid circle.

    Raises
    ------
    InputError
        If a field is not allowed; the message names the field.
    """

    length: Length
    radius: LengthPath
    sections: Annotated[tuple[Anchorage, ...], Meta(min_length=1)]
    material: Material = field(default_factory=Material)
    base_frame: Frame = PAPER_FRAME
    base_position: Place = (0.0, 0.0, 0.0)
    hull: LengthPath | None = None
    rest_curvature: RestCurvature | None = None
    cross_section: Profile | None = None

    def __post_init__(self) -> None:
        warn_unusual("Arm.length", [self.length], LENGTH)
        if (rest := self.rest_curvature) is not None:
            for axis, path in (("n", rest.n), ("b", rest.b)):
                span = np.array([0.0, self.length])
                _evaluated(f"Arm.rest_curvature.{axis}", path, span, self.length)
        ends = [section.at for section in self.sections]
        if ends[0] > self.length * (1 + 1e-12):
            raise InputError(
                "Arm.sections[0].at", ends[0], f"up to the length {length_text(self.length)}"
            )
        for i, (outer, inner) in enumerate(pairwise(ends)):
            if inner >= outer:
                raise InputError(
                    f"Arm.sections[{i + 1}].at", inner, f"below {length_text(outer)}, tip to base"
                )
        s = np.linspace(0.0, self.length, 401)
        radius = _evaluated("Arm.radius", self.radius, s, self.length)
        warn_unusual("Arm.radius", (radius / self.length).tolist(), RADIUS)
        if radius.min() <= 0:
            at = s[np.argmin(radius)]
            raise InputError(
                "Arm.radius", float(radius.min()), f"above 0; see s = {length_text(at)}"
            )
        self.profile.check(np.array(self.radius.evaluate(s, self.length)[:2]), s, self.length)
        bends = list[float]()
        for i, path in self.offset_paths:
            section = self.sections[i]
            s = np.linspace(0.0, section.at, 401)
            offset = np.abs(_evaluated(f"Arm.sections[{i}].offset", path, s, section.at))
            room = _evaluated("Arm.hull", self.hull or self.radius, s, self.length)
            worst = int(np.argmax(offset - room))
            if offset[worst] > room[worst] * (1 + 1e-9):
                raise InputError(
                    f"Arm.sections[{i}].offset",
                    float(offset[worst]),
                    f"up to the radius of the {'hull' if self.hull else 'body'}, "
                    f"{length_text(room[worst])} at s = {length_text(s[worst])}",
                )
            EJ = self.section_stiffness(s)[0, 1:3].min(axis=0)
            bends.append(float(np.trapezoid(offset / EJ, s)))
        if self.cross_section is not None and self.hull is None:
            self._check_tendons(self.cross_section)
        tension = 1 / max(min(bends), SMALLEST)
        is_plastic = PLASTICS[0] <= self.material.E <= PLASTICS[1]
        usual = STIFF_PLASTIC if is_plastic else STIFF
        warn_unusual(
            "Material.E", [tension * (min(bends) > 0)], usual, stiff_text(tension, self.material.E)
        )

    def _check_tendons(self, profile: Profile) -> None:
        """Raise InputError if a tendon is outside of the cross-section."""
        for section in self.sections:
            s = np.linspace(0.0, section.at, 401)
            paths = zip(section.angles, section.offsets, section.angle_paths, strict=True)
            for angle, offset, turn in paths:
                phi = angle + (turn.evaluate(s, section.at)[0] if turn else np.zeros_like(s))
                d = np.array([np.cos(phi), np.sin(phi)])
                profile.check_tendon(offset.evaluate(s, section.at)[0] * d, s, self.length)

    @property
    def profile(self) -> Profile:
        """The shape of the cross-sections; the solid circle by default."""
        return self.cross_section or SOLID

    def section_stiffness(self, s: Array) -> Array:
        """Return E A [N], E J_n, E J_b, G I [N m2] at s (N,), and derivatives along s (2, 4, N)."""
        radius = np.array(self.radius.evaluate(s, self.length)[:2])
        return self.profile.stiffness(self.material, radius, s, self.length)

    def area(self, s: Array) -> Array:
        """Return the area (N,) of the material in the cross-sections at s (N,) [m2]."""
        radius = np.array(self.radius.evaluate(s, self.length)[:2])
        return self.profile.area(radius, s, self.length)

    @classmethod
    def from_paper(cls, name: str) -> Arm:
        """Return an arm of the paper: "table-2", "table-4", "section-5.1" or "section-5.2".

        Raises InputError for another name.
        """
        if not isinstance(name, str) or name not in PAPER_ARMS:
            raise InputError("name", name, f"one of {', '.join(PAPER_ARMS)}")
        return conical(*PAPER_ARMS[name])

    @cached_property
    def tendons(self) -> tuple[tuple[int, float], ...]:
        """(section index from 0, angle [rad]) of each tendon, in tendon order."""
        return tuple((i, phi) for i, sec in enumerate(self.sections) for phi in sec.angles)

    @property
    def base_radius(self) -> float:
        """The radius of the body at the base [m]."""
        return float(self.radius.evaluate(np.zeros(1), self.length)[0][0])

    @property
    def bending_force(self) -> float:
        """The force that bends the straight arm by about 1 rad: E J / L^2 of the base [N]."""
        EJ = self.section_stiffness(np.zeros(1))[0, 1:3].min()
        return float(EJ) / self.length**2

    def outer_radius(self, s: Array) -> tuple[Array, Array, Array]:
        """Return the larger radius of body and hull, and two derivatives, at s (N,) [m].

        Raises InputError if `s` are not arc lengths.
        """
        s = numbers("s", s, "arc lengths [m]")
        values = self.radius.evaluate(s, self.length)
        if self.hull is None:
            return values
        hull = self.hull.evaluate(s, self.length)
        wide = hull[0] > values[0]
        return tuple(np.where(wide, b, a) for a, b in zip(values, hull, strict=True))  # type: ignore[return-value]

    @property
    def anchorages(self) -> tuple[float, ...]:
        """Arc lengths of the anchorages, from the tip to the base [m]."""
        return tuple(section.at for section in self.sections)

    @property
    def offset_paths(self) -> tuple[tuple[int, Path], ...]:
        """(section index from 0, offset) of each section, or of each tendon if offsets differ."""
        each = [(i, section.offset) for i, section in enumerate(self.sections)]
        rows = [(i, row if isinstance(row, tuple) else (row,)) for i, row in each]
        return tuple((i, path) for i, row in rows for path in row)

    @property
    def offset_of(self) -> tuple[int, ...]:
        """The index in `offset_paths` of each tendon."""
        steps = [
            1 if j == 0 or isinstance(section.offset, tuple) else 0
            for section in self.sections
            for j in range(len(section.angles))
        ]
        return tuple(number - 1 for number in accumulate(steps))

    @property
    def angle_paths(self) -> tuple[Path | None, ...]:
        """The additional angle of each tendon along the arm; None for a constant angle."""
        return tuple(path for section in self.sections for path in section.angle_paths)

    @cached_property
    def guides(self) -> tuple[tuple[float, ...] | None, ...]:
        """Arc lengths of the guides of each tendon [m], with base and anchorage.

        None for tendons that are guided continuously.
        """
        return tuple(
            None if each.guides is None else (0.0, *each.guides, each.at)
            for each in self.sections
            for _ in each.angles
        )

    @property
    def is_guided(self) -> bool:
        """Whether a tendon runs straight between guides."""
        return any(section.guides is not None for section in self.sections)

    @cached_property
    def with_continuous_guides(self) -> Arm:
        """The same arm with tendons that are guided continuously."""
        return replace(self, sections=tuple(replace(s, guides=None) for s in self.sections))

    @property
    def tendons_by_section(self) -> list[tuple[float, list[str]]]:
        """Arc length of each anchorage [m], tip first, and the names of its tendons."""
        names = iter(self.tendon_names)
        return [(each.at, [next(names) for _ in each.angles]) for each in self.sections]

    def __repr__(self) -> str:
        cells = [["  section", "at [mm]", "offset [mm]"]]
        angles = ["tendons at [deg]"]
        for i, each in enumerate(self.sections):
            ends = ", ".join(ends_text(path, each.at) for path in dict.fromkeys(each.offsets))
            cells.append([f"  {i + 1}", f"{1e3 * each.at:g}", ends])
            angles.append(" ".join(f"{angle:.4g}" for angle in np.degrees(each.angles)))
        rows = [f"{line}   {angle}" for line, angle in zip(columns(cells), angles, strict=True)]
        m = self.material
        radius = ends_text(self.radius, self.length)
        head = f"Arm of {1e3 * self.length:g} mm, radius {radius} mm, {self.n_tendons} tendons"
        if self.cross_section is not None:
            head += f", {type(self.cross_section).__name__}"
        head += f"; E {m.E / 1e3:g} kPa, nu {m.nu:g}, {m.density:g} kg/m3"
        return "\n".join([head + ", curved at rest" * self.is_curved, *shortened_lines(rows)])

    @property
    def along(self) -> tuple[Path, ...]:
        """All functions of arc length in the equations."""
        tendons = [path for section in self.sections for path in section.paths]
        rest = self.rest_curvature
        curvatures = (rest.n, rest.b) if rest else ()
        return (self.radius, *self.profile.paths, *tendons, *curvatures)

    @property
    def is_curved(self) -> bool:
        """Whether the arm has a curvature at rest."""
        return self.rest_curvature is not None

    @property
    def n_tendons(self) -> int:
        """The number of tendons."""
        return len(self.tendons)

    @property
    def tendon_names(self) -> list[str]:
        """The paper's names of all tendons, T_ij: section i and tendon j, both from 1.

        Text, files and figures have these names: T_11, and T_1_10 for the tenth tendon.
        """
        counts = enumerate((len(section.angles) for section in self.sections), 1)
        return [f"T_{i}{'_' * (j > 9)}{j}" for i, count in counts for j in range(1, count + 1)]

    def tendon_name(self, index: int) -> str:
        """Return the name of a tendon, see tendon_names; raise InputError for a wrong index."""
        return self.tendon_names[whole("index", index, 0, self.n_tendons - 1)]

    def tendons_of(self, section: int) -> tuple[int, ...]:
        """Return the indices of the tendons of a section, numbered from 1 at the tip."""
        number = whole("section", section, 1, len(self.sections))
        return tuple(j for j, (i, _) in enumerate(self.tendons) if i == number - 1)

    def flat(self, values: Any, name: str = "tensions") -> Array:
        """Return one number per tendon in tendon order, from a flat vector or a row per section.

        Raises InputError for a wrong shape, and for NaN, infinite or negative numbers.
        """
        array = np.zeros(0)
        with suppress(TypeError, ValueError):  # rows of different lengths
            array = np.asarray(values)
        are_numbers = array.dtype.kind in "iuf" and not np.ma.is_masked(values)
        if array.shape in self.shapes and are_numbers:
            plain = array.ravel().tolist()
            if min(plain) >= 0 and sum(plain) <= LARGEST:
                return np.array(plain, dtype=float)
        counts = [len(section.angles) for section in self.sections]
        allowed = f"{counted(self.n_tendons, 'number')}, flat or a row per section, tip first "
        allowed += f"({'+'.join(map(str, counts))})"
        if not is_several(values):
            raise InputError(name, values, allowed)
        rows = [numbers(name, row, allowed) for row in values]
        if any(row.ndim > 1 for row in rows):
            raise InputError(name, Described(numbers_text((len(rows), *rows[0].shape))), allowed)
        flat = np.concatenate([np.zeros(0), *map(np.atleast_1d, rows)])
        are_rows = any(row.ndim for row in rows)
        is_flat = not are_rows and flat.size == self.n_tendons
        if not (is_flat or [row.size for row in rows] == counts):
            sizes = f" rows of {', '.join(str(row.size) for row in rows[:4])}"
            raise InputError(name, Described(f"{len(rows)}{sizes * are_rows} numbers"), allowed)
        wrong = np.flatnonzero(~((flat >= 0) & (flat <= LARGEST)))
        if wrong.size:
            j = int(wrong[0])
            allowed = f"a number from 0 to {LARGEST:g}"
            raise InputError(f"{name}[{j}] ({self.tendon_name(j)})", float(flat[j]), allowed)
        return flat

    @cached_property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """The shapes of arrays with one number per tendon: flat, and by section if sections agree.

        The last is the shape of `by_section`.
        """
        by_section = [(len(self.sections), n) for n in {len(s.angles) for s in self.sections}]
        return ((self.n_tendons,), *(by_section if len(by_section) == 1 else ()))

    def by_section(self, flat: Sequence[float] | Array) -> Array:
        """Return one row per section if all have the same number of tendons, else the vector.

        Numbers may be infinite, such as limits, or NaN.
        """
        array = numbers("flat", flat, "numbers")
        if array.shape != (self.n_tendons,):
            raise InputError("flat", flat, counted(self.n_tendons, "number"))
        return array.reshape(self.shapes[-1])


def conical(
    length: float,
    radii: tuple[float, float],
    anchorages: Sequence[tuple[float, float, float]],
    **others: Any,
) -> Arm:
    """Return a conical arm with four tendons per section, from the numbers of the paper's tables.

    Parameters
    ----------
    length : float
        L [m].
    radii : (R_max, R_min)
        At base and tip [m].
    anchorages : sequence of (l_i, a_i, b_i)
        From the tip to the base [m].
    **others
        Further fields of Arm.

    Raises
    ------
    InputError
        If radii or rows have a wrong shape, and as Arm does.
    """
    two = "two numbers, R_max and R_min"
    three = "rows of three numbers, l_i, a_i, b_i"
    ends = numbers("radii", radii, two)
    rows = numbers("anchorages", anchorages, three)
    if ends.shape != (2,):
        raise InputError("radii", radii, two)
    if rows.shape != (0,) and rows.shape[1:] != (3,):
        raise InputError("anchorages", anchorages, three)
    sections = tuple(Anchorage(at, Linear(a, b)) for at, a, b in rows.tolist())
    return Arm(length, Linear(*ends.tolist()), sections, **others)
