"""A settled shape: numbers, and what can be read off them anywhere along the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.cross_section import cross_section_of
from octoplan.model.cross_section.sections import Sections, strains_of
from octoplan.model.effects import ExactTendons, NeoHookean
from octoplan.model.equilibrium.integration import sliding_tensions
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, History
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.equilibrium.stability import stability
from octoplan.model.extensions.clearance.nearest import from_itself
from octoplan.model.extensions.contact.path import ContactEquilibrium
from octoplan.model.extensions.contact.touches import ContactPoint, touches_of
from octoplan.model.forward import by_collocation
from octoplan.model.loads import check_responses, is_loaded
from octoplan.model.mesh import Mesh
from octoplan.model.paths import SAME, Array, Mask
from octoplan.model.rod.collocation import gauss
from octoplan.model.rotations import matrices
from octoplan.model.scene import Scene
from octoplan.model.support.checks import arc_lengths, finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.text import HtmlRepr, plotted, shape_text, tendon_table
from octoplan.model.winches import Winches, pulls, rest_lengths, unfelt

# What is left of a tendon, over the arm's length, from which on it is slack.
_LEFT = 1e-10
# From what part on in a combination of tensions that lengths do not feel a tendon is one of it:
# above rounding, as tensions of the others do not stay where such a combination changes.
_PART = 1e-6


@dataclass(frozen=True, eq=False)
class Shape(HtmlRepr):
    """The shape that an arm takes under given tensions.

    Attributes
    ----------
    arm, scene
        What was settled.
    error : float
        Estimated tip error over arm length [-].
    equilibrium : AnyEquilibrium
        The equations and their solution on the mesh that is accurate enough: what is read off.
    refinement : int
        Of that mesh.
    winches : Winches or None
        What held the tendons, if lengths were given.
    snaps : tuple of float
        With contact, at which shares of tensions and loads the arm jumped on its way from rest.
    on_itself : tuple of ContactPoint
        Where the arm presses on itself: two of each pair of places, from base to tip. The shape is
        that of the scene with these forces as point loads; so is its stability.
    """

    arm: Arm
    scene: Scene
    error: float
    equilibrium: AnyEquilibrium
    refinement: int
    winches: Winches | None = None
    snaps: tuple[float, ...] = ()
    on_itself: tuple[ContactPoint, ...] = ()

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N], tendon order."""
        return self.equilibrium.tensions

    @property
    def history(self) -> History:
        """The order in which loads and tensions acted: see docs/theory.rst.

        "loads first": the loads acted, then the tendons were pulled in proportion. "tensions
        first": the arm does not bear its loads without tension. "near": the tensions changed from
        those of another shape. "together": loads and tensions grew in proportion, with contact.
        """
        point = self.known
        return "loads first" if point is None else point.history

    @property
    def scheme(self) -> str:
        """The integrator that was used."""
        return self.equilibrium.scheme

    @property
    def machine_code(self) -> bool:
        """Whether compiled kernels settled it; what is read off it is found by them too."""
        return self.equilibrium.machine_code

    @property
    def states(self) -> Array:
        """Poses (quaternion, position [m]) at the nodes of the mesh (S + 1, 7)."""
        return self.equilibrium.poses

    @property
    def left(self) -> Array | None:
        """What is left of tendons held by length beyond their paths (n_tendons,), else nan [m].

        None if no lengths were given.
        """
        if self.winches is None:
            return None
        left = self.winches.slack_lengths(self.tendon_lengths, self.tensions)
        return np.where(self.winches.held, left, np.nan)

    @property
    def slack(self) -> Mask:
        """Whether each tendon is slack (n_sections, n), or (n_tendons,) where sections differ.

        One held by length that does not pull and has some of it left; one held by tension that does
        not pull. What pulls is decided by octoplan.model.winches.pulls.
        """
        none = ~pulls(self.arm, self.tensions)
        if self.left is not None:
            none &= ~(self.left <= _LEFT * self.arm.length)
        return self.arm.by_section(none.astype(float)) > 0

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the tendons that may pull otherwise while the lengths are the same; see settle.

        Such as two against each other where neither bends nor shortens the arm. Empty where no
        lengths were given.
        """
        if self.winches is None:
            return ()
        taut = np.flatnonzero(self.winches.held & ~self.slack.ravel())
        result = self.equilibrium.length_tension[np.ix_(taut, taut)]
        idle = unfelt(np.diag(self.winches.stretch[taut]) - result)
        return tuple(
            self.arm.tendon_name(int(j)) for j in taut[np.abs(idle).max(axis=0, initial=0) > _PART]
        )

    @property
    def folded(self) -> float | None:
        """Where from the base a tendon has no length left [m], None where all have some.

        An arm does not bend so far: its body would be folded into itself. Exact tendons settle
        there without loads; with loads such tensions are refused.
        """
        if is_loaded(self.scene) or not self.scene.has(ExactTendons):
            return None
        at = at_ends(self.arm, self.scene, self.equilibrium.mesh)
        crushed = at.crushed(at.strains(self.tensions))
        return crushed.s if crushed else None

    @property
    def lengths(self) -> Array:
        """Tendon lengths [m], a row a section as `Plan.lengths`, flat where sections differ."""
        return self.arm.by_section(self.tendon_lengths)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """The reasons not to believe the shape, a sentence each.

        The arm passes through itself, bends sharper than its own radius, is stretched beyond the
        law of its body, or a tendon has no length left: the equations know no body. `settle` warns
        of sharp bends and of such stretch. With friction of contacts, `error` leaves out how long
        the load steps were.
        """
        folded = self.folded is not None and (
            f"no arm bends so far: at s = {self.folded:.6g} m a tendon has no length left; "
            "lower the tensions that cross it"
        )
        gap = from_itself(self)
        crosses = gap.gap < -_TOUCHES * self.arm.length and (
            f"{gap}; SelfContact among the effects keeps its parts apart"
        )
        point = self.equilibrium
        rubs = isinstance(point, ContactEquilibrium) and point.before is not None and self.contacts
        led = rubs and (
            "friction of contacts acts against load steps: more of them may move the tip by some "
            "thousandths of the length, which is no part of its error; settle shapes in between, "
            "each near the one before"
        )
        return tuple(each for each in (sharp(self), stretched(self), crosses, folded, led) if each)

    @property
    def tip(self) -> Array:
        """Position of the tip (3,) in the base frame [m]."""
        return self.equilibrium.poses[-1, 4:].copy()

    @property
    def tip_frame(self) -> Array:
        """Frame of the tip (3, 3): columns t, n, b."""
        return matrices(self.equilibrium.poses[-1, :4])

    @property
    def s(self) -> Array:
        """Arc lengths of the mesh's nodes (S + 1,) [m]."""
        return self.equilibrium.mesh.s.copy()

    def position(self, s: Any) -> Array:
        """Return positions [m], (3,) or (N, 3), at arc length s [m], a scalar or (N,)."""
        return self.poses(s)[..., 4:]

    def frame(self, s: Any) -> Array:
        """Return frames, (3, 3) or (N, 3, 3), columns t, n, b, at arc length s [m]."""
        return matrices(self.poses(s)[..., :4])

    def poses(self, s: Any) -> Array:
        """Return poses (quaternion, position [m]), (7,) or (N, 7), at arc length s [m]."""
        return self._at(s, lambda places: self.equilibrium.at(places)[0], self.equilibrium.poses)

    def strain(self, s: Any) -> Array:
        """Return strains (tau, xi, k, q), (4,) or (N, 4), at arc length s [m].

        Curvatures are about t, n, b per unit deformed length [1/m], q is the longitudinal strain
        [-]; at an anchorage, those on its base side (the paper's half-open domains).
        """
        return self.strains(s)[..., :4]

    def __repr__(self) -> str:
        tendons_by_section, lengths = self.arm.tendons_by_section, 1e3 * self.tendon_lengths
        tables = [
            tendon_table("tensions [N]", tendons_by_section, self.tensions),
            tendon_table("tendon lengths [mm]", tendons_by_section, lengths),
        ]
        return shape_text(tables, self.tip, self.tip_frame, self.error, self.remarks)

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D; returns a new Figure, or the 3-D axes if given. See plot_shape."""
        return plotted(self, ax)

    def centreline(self, at: Sequence[float] = ()) -> Centreline:
        """Return the midline by elements of its mesh, with arc lengths `at` among the nodes."""
        s = np.sort(np.append(self.s, arc_lengths(at)))
        s = s[np.append(True, np.diff(s) > SAME * self.arm.length)]
        inside = s[:-1, None] + np.diff(s)[:, None] * gauss(STAGES).c
        rows = self.strains(inside.ravel())
        law = cross_section_of(self.scene, self.arm.is_curved)
        v, poses = strains_of(law, rows), self.poses(s)
        return Centreline.at_strains(self.arm, self.scene, s, poses, law, v)

    def strains(self, s: Any) -> Array:
        """Return tau, xi, k, q, and nu_n, nu_b with shear, (N, 4 or 6), at arc length s [m]."""
        return self._at(s, lambda places: self.equilibrium.at(places)[1])

    def tension(self, s: float) -> Array:
        """Return the tension of each tendon (n_tendons,) at arc length s, 0 beyond its end [N].

        With friction it falls along the arm; at an anchorage it is that on the base side.
        """
        place = finite_array("s", self._places(s), (1,))
        ends = np.array([self.arm.sections[i].at for i, _ in self.arm.tendons])
        values, tendons = self.tensions * (ends >= place), np.flatnonzero(ends >= place)
        if (point := self.known) is not None:
            first = np.zeros(tendons.size, dtype=int)
            values[tendons] = sliding_tensions(point.system, point.x, place, first, tendons)
        return values

    @property
    def tendon_lengths(self) -> Array:
        """Length of each tendon from base to anchorage (n_tendons,) [m], tendon order.

        By collocation that of the stages, to which settles by lengths hold the tendons; otherwise
        the integral of ``|du_c/ds|`` by Gauss quadrature.
        """
        return self.equilibrium.lengths

    @cached_property
    def stability(self) -> float:
        """The least eigenvalue of the scaled Hessian of its energy; below 0 it is unstable.

        1 at rest without loads; see octoplan.model.equilibrium.stability. Raises InputError as
        printed, where there is no energy.
        """
        check_responses(self.scene)
        point = self.known
        if point is None or not point.system.layout.form.loaded:
            mesh = STAGES, self.refinement, (), True, self.machine_code
            point = by_collocation(self.arm, self.scene, *mesh).solve(self.tensions)
        return stability(point)

    @property
    def contacts(self) -> tuple[ContactPoint, ...]:
        """What it leans on, from base to tip: obstacle, s [m], force (3,) [N] on it, gap [m]."""
        point = self.equilibrium
        if not (isinstance(point, Equilibrium) and point.system.layout.form.contacts):
            return self.on_itself
        return touches_of(point, point.before if isinstance(point, ContactEquilibrium) else None)

    @property
    def known(self) -> Equilibrium | None:
        """The equations by collocation and their solution, for other meshes to begin with."""
        return self.equilibrium if isinstance(self.equilibrium, Equilibrium) else None

    def _places(self, s: Any) -> Array:
        """Return arc lengths of the arm (N,) [m] of a scalar or (N,); InputError for others."""
        places, L = arc_lengths(s), self.arm.length
        if places.size and (places.min() < 0 or places.max() > L * (1 + 1e-12)):
            raise InputError("s", s, f"arc lengths from 0 to {L:g} m")
        return np.minimum(places, L)

    def _at(self, s: Any, read: Callable[[Array], Array], at_nodes: Array | None = None) -> Array:
        """Return what is read at s, a scalar or (N,); where all of s are nodes, what is known."""
        places, nodes = self._places(s), self.equilibrium.mesh.s
        near = np.minimum(np.searchsorted(nodes, places), nodes.size - 1)
        values = np.zeros((0, 4))
        if at_nodes is not None and np.array_equal(nodes[near], places):
            values = at_nodes[near]
        elif places.size:
            values = read(places)
        return np.asarray(values[0] if np.ndim(s) == 0 else values)


# How deep parts may be in each other, over the arm's length: what contact of them leaves.
_TOUCHES = 1e-6


def at_ends(arm: Arm, scene: Scene, mesh: Mesh) -> Sections:
    """Return the cross-sections at both ends of the elements of a mesh, without loads."""
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    law = cross_section_of(scene, arm.is_curved, twisted=False)
    return Sections(arm, scene, law, ends, np.repeat(mesh.active, 2))


def sharp(shape: Shape) -> str:
    """Return where the body bends by less than its own radius, and what that takes of tendons.

    Its inner side would have no length left. Empty where it does not, at the places of the mesh.
    """
    arm, (_, _, s, radius, bend, _, _) = shape.arm, shape.equilibrium.extremes
    if not bend >= 1:
        return ""
    lengths, rest = shape.tendon_lengths, rest_lengths(arm)
    j = int(np.argmax(lengths - rest))
    longer = (
        f", and tendon {arm.tendon_name(j)} would have to be {1e3 * lengths[j]:.4g} mm long, "
        f"{1e3 * rest[j]:.4g} mm at rest"
    )
    return (
        f"the arm bends sharper than its own radius: by a radius of {1e3 * radius / bend:.3g} mm "
        f"at s = {s:.6g} m, where its body has one of {1e3 * radius:.3g} mm"
        f"{longer * bool(lengths[j] > rest[j])}; lower the tensions or the loads"
    )


# Stretch from which on the law of the body is no description of a material: a linear law of small
# strains, and a neo-Hookean one of rubber before it stiffens.
MOST_STRETCH, MOST_RUBBER_STRETCH = 2.0, 3.0


def stretched(shape: Shape) -> str:
    """Return where the arm is stretched beyond the law of its body; empty if it is not."""
    most = MOST_RUBBER_STRETCH if shape.scene.has(NeoHookean) else MOST_STRETCH
    extremes = shape.equilibrium.extremes
    if not extremes.longest >= most:
        return ""
    law = "neo-Hookean" if shape.scene.has(NeoHookean) else "linear"
    return (
        f"the arm is stretched to {extremes.longest:.3g} times its length at "
        f"s = {extremes.long_at:.6g} m, where its {law} law holds up to {most:g} times; "
        "lower the loads or stiffen the arm"
    )
