"""A settled shape: the equilibrium, evaluated anywhere along the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections, strains_of
from octoplan.model.effects.sections import ExactTendons, NeoHookean
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, History
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.forward import collocation_map
from octoplan.model.loads import check_responses, has_complementarity, is_coupled
from octoplan.model.mesh import Mesh
from octoplan.model.paths import SAME, Array, Mask
from octoplan.model.rod.collocation import gauss
from octoplan.model.rotations import matrices
from octoplan.model.scene import Scene
from octoplan.model.support.checks import arc_lengths, finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.text import HtmlRepr, plotted, shape_text, tendon_table
from octoplan.model.support.units import length_text
from octoplan.model.tendons import is_taut, rest_lengths

if TYPE_CHECKING:
    from octoplan.model.centreline import Centreline
    from octoplan.model.extensions.contact.touches import ContactPoint
    from octoplan.model.extensions.lengths.winches import Winches

# Smallest slack length of a slack tendon with a given length, over the arm's length.
_SLACK_LENGTH = 1e-10
# Smallest component of a tendon in an undetermined combination of tensions. Above rounding, because
# the other tensions change slightly with the combination.
_UNDETERMINED = 1e-6
# Largest depth by which parts of the arm penetrate each other in contact, over the arm's length.
_PENETRATION = 1e-6
# Largest ratio of total pull and Euler load between discs at which the shape is that of continuous
# guides: at a ratio of 0.04 the tip differs by 0.4 % of the length at a bend of 23 degrees.
_FEW_DISCS = 0.05
# Number of arc lengths at which the smallest radius is sought.
_RADIUS_SAMPLES = 33
# Stretch beyond which a linear law describes no material.
LINEAR_STRETCH = 2.0
# Stretch beyond which a neo-Hookean law describes no rubber, which then stiffens.
RUBBER_STRETCH = 3.0


@dataclass(frozen=True, eq=False)
class Shape(HtmlRepr):
    """The shape of an arm in static equilibrium.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    error : float
        Estimated tip error over arm length [-].
    equilibrium : AnyEquilibrium
        The equations and the solution on the mesh that is accurate enough.
    refinement : int
        Refinement of this mesh.
    winches : Winches or None
        The winches of the tendons, if lengths were given.
    snaps : tuple of float
        With contact, fractions of the changes of loads and of tensions at which the arm jumped.
    self_contacts : tuple of ContactPoint
        Points at which the arm presses on itself, in pairs, from base to tip. Shape and stability
        result from the scene with the contact forces as point loads.
    """

    arm: Arm
    scene: Scene
    error: float
    equilibrium: AnyEquilibrium
    refinement: int
    winches: Winches | None = None
    snaps: tuple[float, ...] = ()
    self_contacts: tuple[ContactPoint, ...] = ()

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N] in tendon order."""
        return self.equilibrium.tensions

    @property
    def history(self) -> History:
        """The order in which loads and tensions acted; see docs/theory.rst.

        "loads first": the loads acted, then the tensions grew in proportion. "tensions first": the
        arm does not bear its loads without tension. "near": the tensions changed from the tensions
        of another shape.
        """
        point = self.collocated
        return "loads first" if point is None else point.history

    @property
    def scheme(self) -> str:
        """The name of the integrator."""
        return self.equilibrium.scheme

    @property
    def machine_code(self) -> bool:
        """Whether compiled kernels settled the arm and evaluate the shape."""
        return self.equilibrium.machine_code

    @property
    def states(self) -> Array:
        """Poses (quaternion, position [m]) at the nodes of the mesh (S + 1, 7)."""
        return self.equilibrium.poses

    @property
    def slack_lengths(self) -> Array | None:
        """The slack lengths of tendons with given lengths (n_tendons,), otherwise NaN [m].

        The value is None if no lengths were given.
        """
        if self.winches is None:
            return None
        slack = self.winches.slack_lengths(self.tendon_lengths, self.tensions)
        return np.where(self.winches.held, slack, np.nan)

    @property
    def slack(self) -> Mask:
        """Whether each tendon is slack (n_sections, n), or (n_tendons,) if sections differ.

        A slack tendon is not taut, see octoplan.model.tendons.is_taut. A tendon with a
        given length also needs a slack length.
        """
        none = ~is_taut(self.arm, self.tensions)
        if self.slack_lengths is not None:
            none &= ~(self.slack_lengths <= _SLACK_LENGTH * self.arm.length)
        return self.arm.by_section(none.astype(float)) > 0

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the tendons whose tensions the given lengths do not determine; see settle.

        An example is two antagonists that neither bend nor shorten the arm. Empty if no lengths
        were given.
        """
        if self.winches is None:
            return ()
        taut = np.flatnonzero(self.winches.held & ~self.slack.ravel())
        response = self.equilibrium.length_tension[np.ix_(taut, taut)]
        idle = self.winches.undetermined_tensions(taut, response)
        is_part = np.abs(idle).max(axis=0, initial=0) > _UNDETERMINED
        return tuple(self.arm.tendon_name(int(j)) for j in taut[is_part])

    @property
    def folded(self) -> float | None:
        """The first arc length at which a tendon has no length left [m], otherwise None.

        The body of such an arm would fold into the arm. Without loads, an arm with exact tendons
        settles in this state; under loads, settle raises an error.
        """
        if is_coupled(self.arm, self.scene) or not self.scene.has(ExactTendons):
            return None
        at = at_ends(self.arm, self.scene, self.equilibrium.mesh)
        crushed = at.crushed(at.strains(self.tensions))
        return crushed.s if crushed else None

    @property
    def lengths(self) -> Array:
        """Tendon lengths [m], a row per section as in `Plan.lengths`; flat if sections differ."""
        return self.arm.by_section(self.tendon_lengths)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """The reasons not to trust the shape, one sentence each.

        Reasons are: the arm passes through itself, bends sharper than its own radius, is stretched
        beyond the law of the body, a tendon has no length left, or discs are few for
        continuous guides. The equations do not exclude
        such states. `settle` warns of sharp bends and of stretch. With friction of contact,
        `error` ignores the length of the load steps.
        """
        from octoplan.model.extensions.clearance.nearest import from_itself

        folded = ""
        if self.folded is not None:
            folded = (
                f"no arm bends so far: at s = {self.folded:.6g} m a tendon has no length left; "
                "lower the tensions that cross it"
            )
        crosses = ""
        gap = from_itself(self)
        if gap.gap < -_PENETRATION * self.arm.length:
            crosses = f"{gap}; SelfContact among the effects keeps its parts apart"
        remarks = [sharp(self), stretched(self), crosses, folded]
        remarks.append(guide_remark(self.arm, self.tensions))
        remarks += [effect.remark(self) for effect in self.scene.effects]
        return tuple(dict.fromkeys(filter(None, remarks)))

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
        """Arc lengths of the nodes of the mesh (S + 1,) [m]."""
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

        Curvatures are about t, n, b per unit deformed length [1/m], and q is the longitudinal
        strain [-]. At an anchorage the result is on the base side, as in the paper's
        half-open domains.
        """
        return self.strains(s)[..., :4]

    def __repr__(self) -> str:
        tendons_by_section = self.arm.tendons_by_section
        tables = [
            tendon_table("tensions [N]", tendons_by_section, self.tensions),
            tendon_table("tendon lengths [mm]", tendons_by_section, 1e3 * self.tendon_lengths),
        ]
        return shape_text(tables, self.tip, self.tip_frame, self.error, self.remarks)

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D. Return a new Figure, or the given 3-D axes. See plot_shape."""
        return plotted(self, ax)

    def centreline(self, at: Sequence[float] = ()) -> Centreline:
        """Return the centreline on the elements of the mesh, with further nodes `at` [m]."""
        from octoplan.model.centreline import Centreline

        s = np.sort(np.append(self.s, arc_lengths(at)))
        s = s[np.append(True, np.diff(s) > SAME * self.arm.length)]
        inside = s[:-1, None] + np.diff(s)[:, None] * gauss(STAGES).c
        law = cross_section_of(self.scene, self.arm.is_curved)
        v = strains_of(law, self.strains(inside.ravel()))
        return Centreline.at_strains(self.arm, self.scene, s, self.poses(s), law, v)

    def strains(self, s: Any) -> Array:
        """Return tau, xi, k, q, and nu_n, nu_b with shear, (N, 4 or 6), at arc length s [m]."""
        return self._at(s, lambda places: self.equilibrium.at(places)[1])

    def tension(self, s: float) -> Array:
        """Return the tension of each tendon (n_tendons,) at arc length s, 0 beyond the end [N].

        With friction, tensions vary along the arm. At an anchorage the result is on the base side.
        """
        place = finite_array("s", self._places(s), (1,))
        ends = np.array([self.arm.sections[i].at for i, _ in self.arm.tendons])
        values = self.tensions * (ends >= place)
        tendons = np.flatnonzero(ends >= place)
        point = self.collocated
        if point is not None:
            from octoplan.model.equilibrium.integration import tendon_tensions

            first = np.zeros(tendons.size, dtype=int)
            values[tendons] = tendon_tensions(point.system, point.x, place, first, tendons)
        return values

    @property
    def tendon_lengths(self) -> Array:
        """Length of each tendon from base to anchorage (n_tendons,) [m] in tendon order.

        With collocation, the lengths are integrals over the stages, which given lengths constrain.
        Otherwise the lengths are the integrals of ``|du_c/ds|`` by Gauss quadrature.
        """
        return self.equilibrium.lengths

    @cached_property
    def stability(self) -> float:
        """The least eigenvalue of the scaled Hessian of the energy; below 0 the arm is unstable.

        The value is 1 at rest without loads; see octoplan.model.equilibrium.modes. Raises
        InputError in a scene as printed, which has no energy.
        """
        from octoplan.model.equilibrium.modes import stability

        check_responses(self.scene)
        point = self.collocated
        if point is None or not point.system.layout.structure.has_moment:
            equations = collocation_map(
                self.arm,
                self.scene,
                self.refinement,
                machine_code=self.machine_code,
                moments=True,
            )
            point = equations.solve(self.tensions)
        return stability(point)

    @property
    def contacts(self) -> tuple[ContactPoint, ...]:
        """The contact points from base to tip: obstacle, s [m], force (3,) on the arm [N], ..."""
        if not has_complementarity(self.scene):
            return self.self_contacts
        from octoplan.model.extensions.contact.points import contact_points

        return contact_points(self)

    @property
    def collocated(self) -> Equilibrium | None:
        """The equilibrium if collocation solved it, otherwise None; the guess for other meshes."""
        return self.equilibrium if isinstance(self.equilibrium, Equilibrium) else None

    def _places(self, s: Any) -> Array:
        """Return arc lengths of the arm (N,) [m] of a scalar or (N,); raise InputError."""
        places = arc_lengths(s)
        L = self.arm.length
        if places.size and (places.min() < 0 or places.max() > L * (1 + 1e-12)):
            raise InputError("s", s, f"arc lengths from 0 to {L:g} m")
        return np.minimum(places, L)

    def _at(
        self, s: Any, evaluate: Callable[[Array], Array], at_nodes: Array | None = None
    ) -> Array:
        """Return values at s, a scalar or (N,): `at_nodes` if every s is a node."""
        places = self._places(s)
        nodes = self.equilibrium.mesh.s
        near = np.minimum(np.searchsorted(nodes, places), nodes.size - 1)
        values = np.zeros((0, 4))
        if at_nodes is not None and np.array_equal(nodes[near], places):
            values = at_nodes[near]
        elif places.size:
            values = evaluate(places)
        return np.asarray(values[0] if np.ndim(s) == 0 else values)


def at_ends(arm: Arm, scene: Scene, mesh: Mesh) -> Sections:
    """Return the cross-sections at both ends of the elements of a mesh, without loads."""
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    ends = mesh.inside(np.repeat(np.arange(mesh.elements), 2), ends)
    law = cross_section_of(scene, arm.is_curved, twisted=False)
    return Sections(arm, scene, law, ends, np.repeat(mesh.active, 2))


def sharp(shape: Shape) -> str:
    """Return a remark if the arm bends sharper than its own radius, otherwise "".

    The inner side of the body would have no length left. The remark names the tendon with the
    largest elongation.
    """
    arm = shape.arm
    extremes = shape.equilibrium.extremes
    if not extremes.bend >= 1:
        return ""
    lengths = shape.tendon_lengths
    rest = rest_lengths(arm)
    j = int(np.argmax(lengths - rest))
    longer = ""
    if lengths[j] > rest[j]:
        longer = (
            f", and tendon {arm.tendon_name(j)} would have to be {1e3 * lengths[j]:.4g} mm long, "
            f"{1e3 * rest[j]:.4g} mm at rest"
        )
    bend_radius = 1e3 * extremes.radius / extremes.bend
    return (
        f"the arm bends sharper than its own radius: by a radius of {bend_radius:.3g} mm at "
        f"s = {extremes.bent_at:.6g} m, where its body has one of {1e3 * extremes.radius:.3g} mm"
        f"{longer}; lower the tensions or the loads"
    )


def stretched(shape: Shape) -> str:
    """Return a remark if the arm is stretched beyond the law of its body, otherwise ""."""
    extremes = shape.equilibrium.extremes
    if not extremes.longest >= LINEAR_STRETCH:
        return ""
    is_rubber = shape.scene.has(NeoHookean)
    most = RUBBER_STRETCH if is_rubber else LINEAR_STRETCH
    if extremes.longest < most:
        return ""
    law = "neo-Hookean" if is_rubber else "linear"
    return (
        f"the arm is stretched to {extremes.longest:.3g} times its length at "
        f"s = {extremes.long_at:.6g} m, where its {law} law holds up to {most:g} times; "
        "lower the loads or stiffen the arm"
    )


def guide_remark(arm: Arm, tensions: Array) -> str:
    """Return a remark if the arm states too few discs for continuous guides, otherwise "".

    The tendons in a hull are guided by discs, and the anchorages are the only discs that an arm
    without guides states. Between discs the arm is a column under the total pull P of the tendons
    that cross. Its Euler load is pi^2 EJ / l^2, with the least EJ of the segment of length l. The
    shape differs from that of continuous guides in proportion to the ratio.
    """
    if arm.hull is None or all(section.guides is not None for section in arm.sections):
        return ""
    discs = np.array([0.0, *sorted(arm.anchorages)])
    ends = np.array([arm.sections[i].at for i, _ in arm.tendons])
    worst = (0.0, 0.0, 0.0)
    for a, b in pairwise(discs.tolist()):
        pull = float(tensions[ends >= b * (1 - SAME)].sum())
        EJ = arm.section_stiffness(np.linspace(a, b, _RADIUS_SAMPLES))[0, 1:3].min()
        euler = float(np.pi**2 * EJ / (b - a) ** 2)
        worst = max(worst, (pull / euler, a, b))
    ratio, a, b = worst
    if ratio <= _FEW_DISCS:
        return ""
    return (
        "tendons in the hull count as guided continuously; with discs at the anchorages alone, "
        f"the total pull is {ratio:.2g} times the Euler load of the segment from {length_text(a)} "
        f"to {length_text(b)}; state the discs as Anchorage.guides"
    )
