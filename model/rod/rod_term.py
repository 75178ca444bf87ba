"""The interface by which an effect extends the rod: a rod term.

A rod has one law of its cross-sections and any number of rod terms. The members of a term that
return SX expressions are evaluated once for each structure, and the members that return arrays for
each arm and mesh. A term depends neither on the mesh, nor on the order of the unknowns, nor on the
solver. The default of each member contributes nothing.

A complete example of a new effect with its rod term is tests/core/model/test_magnetic_tip.py.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.mesh import Counts, Mesh
from octoplan.model.paths import Array
from octoplan.model.rod.equations import ParameterValues, PlacedKernel
from octoplan.model.rod.kernels import Name

if TYPE_CHECKING:
    from octoplan.model.cross_section.law import CrossSection
    from octoplan.model.rod.structure import RodPlaces, RodPoints

# Sizes of parameters, and their symbols or values, by name.
Sizes = dict[str, int]
Symbols = dict[str, ca.SX]
Values = dict[str, Array]
# (step, node of the scheme), positions (P, 3) -> loads per length (P, 3) in base and local frame.
ElementLoad = Callable[[tuple[int, int], Array], tuple[Array, Array]]


def _undefined(rows: int, columns: int = 1) -> Callable[[], ca.SX]:
    """Return a default of NaN for quantities that a kernel does not provide, to detect use."""
    return partial(ca.SX.nan, rows, columns)


@dataclass(frozen=True)
class SectionView:
    """Symbols of the cross-section at a stage of an element, for one term.

    Vectors are in the frame of the first node of the element unless stated otherwise; `from_base`
    rotates vectors from the base frame to this frame. The view contains no position: loads per
    length depend on orientations and strains only, because the stability test omits derivatives by
    positions.

    Attributes
    ----------
    strains : (n_strains,)
    variables : (n,)
        Additional stage variables of the term.
    parameters : dict of (size,)
        Section parameters and uniform parameters of the term, by name.
    load_factor : scalar
        Factor of all loads: 0 without loads, 1 with all of their strength.
    body, body_rate : (n,)
        Parameters of the body in the law, and their derivatives along s. Only `body_equations`
        receives them; all later attributes are undefined there.
    frame : (3, 3)
        Columns t, n, b.
    kappa, nu : (3,)
        Curvature [1/m] and tangent [-] in local components.
    from_base : callable
        Rotates a vector (3,) of the base frame.
    moment, force : (3,)
        Internal moment [N m] and force [N] in local components; defined in `section_equations`.
    load : (3,)
        Sum of the shape-dependent loads [N/m]; defined in `section_equations`.
    distributed_moment : (3,)
        Sum of the moments per length [N m/m]; defined in `section_equations`.
    """

    strains: ca.SX
    variables: ca.SX
    parameters: Symbols
    load_factor: ca.SX = field(default_factory=_undefined(1))
    body: ca.SX = field(default_factory=_undefined(6))
    body_rate: ca.SX = field(default_factory=_undefined(6))
    frame: ca.SX = field(default_factory=_undefined(3, 3))
    kappa: ca.SX = field(default_factory=_undefined(3))
    nu: ca.SX = field(default_factory=_undefined(3))
    from_base: Callable[[ca.SX], ca.SX] = lambda vector: ca.SX.nan(3)
    moment: ca.SX = field(default_factory=_undefined(3))
    force: ca.SX = field(default_factory=_undefined(3))
    load: ca.SX = field(default_factory=_undefined(3))
    distributed_moment: ca.SX = field(default_factory=_undefined(3))


@dataclass(frozen=True)
class TendonView:
    """Symbols of a tendon in the cross-section at a stage, for one term.

    Attributes
    ----------
    strains, variables
        See SectionView.
    path : (4,)
        Offset along n and b [m], and its derivative along s [-].
    parameters : dict of (size,)
        Tendon parameters of the term, by name.
    load_factor : scalar
        See SectionView.
    states : (n_tendon_states,)
        States of the tendon that belong to the term; defined in `tension_ratio` alone.
    define : function
        Marks intermediates of expressions, see octoplan.model.rod.kernels.
        `tendon_state_rate` and `tendon_equations` share equal intermediates.
    """

    strains: ca.SX
    variables: ca.SX
    path: ca.SX
    parameters: Symbols
    load_factor: ca.SX = field(default_factory=_undefined(1))
    states: ca.SX = field(default_factory=_undefined(1))
    define: Name = ca.densify


@dataclass(frozen=True)
class NodeView:
    """Symbols of a node, for one term.

    Attributes
    ----------
    frame : (3, 3)
        Columns t, n, b in the base frame. Forces and moments may depend on orientations only,
        because the stability test omits derivatives by positions; contact, which depends on
        positions, has kernels of its own and no stability test of this kind.
    variables : (n_node_variables,)
        Node variables of the term.
    parameters : dict of (size,)
        Node parameters of the term, by name.
    """

    frame: ca.SX
    variables: ca.SX
    parameters: Symbols


class RodTerm:
    """Contribution of an effect to the rod. The default of each member contributes nothing.

    Attributes
    ----------
    couples_sections : bool
        Whether the effect couples or twists the cross-sections: then the moment is a state of the
        nodes, and torsion is a strain. True for all loads, shear and friction.
    depends_on_shape : bool
        Whether the term has a `load_per_length` or a `node_force`. The force is then a state of
        the nodes. A term that overrides one of them without this attribute is rejected.
    couples_nodes : bool
        Whether the term has kernels that couple wrenches of nodes to poses of other nodes, or to
        positions. The stability test then uses the whole Jacobian instead of element blocks.
    n_tendon_states : int
        Number of states of each tendon at each node.
    uniform_parameters, section_parameters, tendon_parameters, node_parameters : dict of int
        Sizes of the parameters in the expressions, by name: of parameters that are constant along
        the rod, and of parameters for each cross-section, for each tendon in a cross-section, and
        for each node.
    """

    couples_sections: bool = False
    depends_on_shape: bool = False
    couples_nodes: bool = False
    n_tendon_states: int = 0
    uniform_parameters: ClassVar[Sizes] = {}
    section_parameters: ClassVar[Sizes] = {}
    tendon_parameters: ClassVar[Sizes] = {}
    node_parameters: ClassVar[Sizes] = {}

    @property
    def bends(self) -> bool:
        """Whether the load may bend an arm to the other side than the tendons do."""
        return self.couples_sections

    @property
    def is_conservative(self) -> bool:
        """Whether the load has a potential."""
        return True

    @property
    def n_node_variables(self) -> int:
        """The number of variables at each node."""
        return 0

    @property
    def is_nonsmooth(self) -> bool:
        """Whether the equations have kinks, at which Newton's method may alternate."""
        return False

    # Structure

    def structure(self) -> Hashable:
        """Return all values in the expressions that are no parameters; None if there are none."""
        return None

    def n_stage_variables(self, law: CrossSection) -> int:
        """Return the number of additional variables at each stage."""
        return 0

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return the arc lengths inside the arm [m] at which the mesh must have a node."""
        return ()

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the nodes at which the term has forces, moments and free variables.

        Terms without nodes and without node variables have no kernels of their own, too.
        """
        return ()

    def convergence_order(self, order: int, derivatives: bool, is_bent: bool) -> int:
        """Return the order at which errors decrease.

        Parameters
        ----------
        order : int
            The order of smooth solutions.
        derivatives : bool
            Whether the order of derivatives of the equilibrium is asked for.
        is_bent : bool
            Whether a term of the scene `bends` the arm.
        """
        return order

    # Loads. The rod multiplies these members by the load factor, but not `element_kernels`.

    def dead_resultant(self, arm: Arm, s: Array, end: Array) -> Array:
        """Return the resultant (3, n) [N] of the dead forces between s (n,) and the tip.

        The result is in the base frame. `end` (n,) are the last nodes of the elements that contain
        s. A force at a node is included if its arc length is at least `end`.
        """
        return np.zeros((3, s.size))

    def dead_load_per_length(self, arm: Arm, s: Array) -> Array:
        """Return the distributed part of the dead loads (3, n) [N/m] at s (n,), base frame.

        This is minus the derivative of `dead_resultant` along s. It adds no load: terms that
        differentiate the balance along s, such as friction, use it. Override both or neither.
        """
        return np.zeros((3, s.size))

    def load_per_length(self, section: SectionView) -> ca.SX:
        """Return the shape-dependent load (3,) per unit reference length [N/m].

        The result is in the frame of the first node of the element; see SectionView.
        """
        return ca.SX(3, 1)

    def moment_per_length(self, section: SectionView) -> ca.SX:
        """Return the moment (3,) per unit reference length [N m/m], which may depend on frames.

        The result is in the frame of the first node of the element; see SectionView.
        """
        return ca.SX(3, 1)

    def node_force(self, node: NodeView) -> ca.SX:
        """Return the shape-dependent force (3,) [N] on a node, in the base frame."""
        return ca.SX(3, 1)

    def node_moment(self, node: NodeView) -> ca.SX:
        """Return the moment (3,) [N m] on a node, in the base frame."""
        return ca.SX(3, 1)

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return a bound of the resultant force (n,) [N] between s (n,) and the tip."""
        return np.zeros(s.size)

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return bounds of the moments per squared rotation of a cross-section.

        Pairs of an arc length [m] and a moment [N m], for all loads except dead forces on the
        midline. The bound of the rotations does not decrease from base to tip, so that the lever
        arm to the base bounds a load that depends on the shape. By default the moment of a load
        that bends the arm has no bound, so that stability is always tested.
        """
        return ((arm.length, np.inf),) if self.bends else ()

    # Tendons

    def tension_ratio(self, tendon: TendonView) -> ca.SX:
        """Return the tension at a cross-section over the tension at the motor."""
        return ca.SX(1)

    def tendon_state_rate(self, law: CrossSection, tendon: TendonView) -> ca.SX:
        """Return the derivatives (n_tendon_states,) of the tendon states along s.

        The rates depend on strains, variables, path and parameters, not on the states.
        """
        return ca.SX(0, 1)

    def tendon_jump(
        self,
        law: CrossSection,
        before: Sequence[TendonView],
        after: Sequence[TendonView],
        h: ca.SX,
    ) -> ca.SX:
        """Return the jump (n_tendon_states,) of the states where other tendons end.

        Parameters
        ----------
        before, after : sequence of TendonView
            The tendon at the stages of the elements on the base side and on the tip side, each with
            the path at the node between and without parameters.
        h : (2,)
            Lengths of these elements [m].
        """
        return ca.SX(0, 1)

    # Equations of the stage variables, as the sum of three shares, and of the node variables

    def section_equations(self, law: CrossSection, section: SectionView) -> ca.SX:
        """Return the share (n_stage_variables,) that depends on frame, wrench and loads."""
        return ca.SX(self.n_stage_variables(law), 1)

    def body_equations(self, law: CrossSection, section: SectionView) -> ca.SX:
        """Return the share (n_stage_variables,) of the body."""
        return ca.SX(self.n_stage_variables(law), 1)

    def tendon_equations(self, law: CrossSection, tendon: TendonView) -> ca.SX:
        """Return the share (n_stage_variables,) of one tendon per newton of its tension T."""
        return ca.SX(self.n_stage_variables(law), 1)

    def tension_rate_equations(self, law: CrossSection, wrench: ca.SX) -> ca.SX:
        """Return the share (n_stage_variables,) of one tendon per unit of T' [N/m].

        `wrench` (n_strains,) is the wrench of the tendon per newton of its tension.
        """
        return ca.SX(self.n_stage_variables(law), 1)

    def node_equations(self, node: NodeView) -> ca.SX:
        """Return the equations (n_node_variables,) of the node variables."""
        return ca.SX(self.n_node_variables, 1)

    # Kernels of the term, if the views of one section or one node are not sufficient

    def node_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return placed kernels of the nodes in place of node forces, moments and equations.

        The rows are the wrenches of nodes and the equations of all node variables of the term.
        """
        return []

    def element_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return placed kernels of the elements, in addition to the kernels of the rod."""
        return []

    def length_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return placed kernels of tendon lengths [m]; the rows are indices of tendons.

        The rod integrates the lengths of all tendons without guides itself.
        """
        return []

    def signed_friction(self, arm: Arm) -> tuple[float, ...]:
        """Return direction mu of each tendon; () for terms other than tendon friction."""
        return ()

    def tension_factors(
        self, variables: Array, load_factor: float, mesh: Mesh, s: Array, tendon: Counts
    ) -> Array:
        """Return the tensions (P,) of tendons at P arc lengths over those without this term.

        For terms whose node variables determine tensions. `tension_ratio` is no part of the result.

        Parameters
        ----------
        variables : (N + 1, n_node_variables)
            Values of the node variables.
        s, tendon : (P,), (P,)
            Arc length [m] and index of a tendon.
        """
        return np.ones(s.size)

    def length_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the parameter values of `length_kernels`."""
        return {}

    def kernel_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the parameter values of the kernels of the term."""
        return {}

    def element_load(
        self, variables: Array, parameters: ParameterValues, elements: Counts, share: Array
    ) -> ElementLoad | None:
        """Return the loads of `element_kernels` per unit reference length, for integrators.

        Parameters
        ----------
        variables : (N + 1, n_node_variables)
            Values of the node variables.
        parameters : dict
            Parameters of all kernels, by kernel and name.
        elements, share : (P,), (substeps, nodes, P)
            Elements, and places in them from 0 to 1.
        """
        return None

    def step_sizes(self, steps: Array, states: Array, mesh: Mesh) -> Array:
        """Return the relative sizes (M,) of M steps of the node variables (M, N + 1, n)."""
        return np.zeros(len(steps))

    # Parameter values

    def uniform_values(self, arm: Arm) -> Values:
        """Return the values (size,) of the uniform parameters."""
        return {}

    def section_values(self, points: RodPoints) -> Values:
        """Return the values (size, n) of the section parameters at n cross-sections."""
        return {}

    def tendon_values(self, points: RodPoints, place: Counts, tendon: Counts) -> Values:
        """Return the values (size, P) of the tendon parameters at P crossings.

        Crossing i is tendon `tendon[i]` in the cross-section `place[i]` of the points.
        """
        return {}

    def node_values(self, arm: Arm, mesh: Mesh, nodes: Counts) -> Values:
        """Return the values (size, n) of the node parameters at n nodes."""
        return {}

    def stage_scales(self, arm: Arm, strain: Array, balance: Array) -> tuple[Array, Array]:
        """Return the scales (n, n_stage_variables) of the stage variables and their equations.

        `strain` and `balance` are the scales (n, n_strains) of strains and balance equations.
        """
        return strain[:, :0], balance[:, :0]

    def node_scales(self, arm: Arm) -> tuple[Array, Array]:
        """Return the scales (n_node_variables,) of the node variables and their equations."""
        return np.ones(self.n_node_variables), np.ones(self.n_node_variables)

    def initial_stage_variables(self, strains: Array, h: Array) -> Array:
        """Return initial values (..., N, m, n_stage_variables) of the stage variables.

        `strains` (..., N, m, n_strains) are at the m stages of N elements of lengths h (N,) [m].
        """
        return strains[..., :0]

    def initial_node_variables(self, arm: Arm) -> Array:
        """Return initial values (n_node_variables,) of the node variables."""
        return np.zeros(self.n_node_variables)

    def interpolated_variables(
        self, shares: Array, strains: Array, variables: Array, h: Array
    ) -> Array:
        """Return the stage variables (..., P, n_stage_variables) between the stages.

        Parameters
        ----------
        shares : (..., P)
            Places in P elements, from 0 to 1.
        strains, variables : (P, m, n)
            Values at the stages of these elements.
        h : (P,)
            Lengths of these elements [m].
        """
        return np.zeros((*shares.shape, 0))
