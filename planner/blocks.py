"""Blocks of the program: least stretch, limits of tensions, strokes, stability and stiffness.

    least stretch     1 + q >= 1e-3, at one place of each segment
    largest tension   unknown T_max:        T_max - T_j >= 0
    total pull        sum_j T_j <= limit
    responses         unknowns Y:           dr/dx Y + dr/dp f = 0,   compliance D^T Y_tip
    stability margin  unknowns y, sigma:    dr/dS y - sigma B y = 0,   |y| = 1,   sigma >= margin
    tendon lengths    unknowns l_j:         integral of |c_j'| - l_j = 0,   l_min <= l_j <= l_max

r are the equations of equilibrium, x all their unknowns and S the states among these; f is a small
force on the tip, y the least stable mode, B the stiffness of the body at rest, and c_j the curve of
a tendon. The products with dr/dx are assembled from linearised kernels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import CrossSection, size
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.stability import least_modes, rest_stiffness
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import ParameterValues, Term
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.nodes import POSE
from octoplan.model.rod.tendons import tendon_length
from octoplan.model.shape import Shape
from octoplan.model.support.machine.functions import cached
from octoplan.model.tendons import least_compliance
from octoplan.planner.block import Block, Parts, ProgramView, Rows
from octoplan.planner.linearised_kernel import linearised, linearised_in
from octoplan.planner.targets.base import ComplianceRequest
from octoplan.planner.targets.target_set import tip_compliance

# Kinds of rows.
STRETCH = "stretch"
PEAK = "peak"
TOTAL_PULL = "total pull"
STABILITY = "stability"
STROKES = "strokes"
# Least stretch 1 + q of a plan [-].
PLANNED_STRETCH = 1e-3
# Stretch above which a cross-section is far from collapse, so that its defect is left out [-].
FAR_FROM_COLLAPSE = 0.1


def equilibrium_parameters(rod: DiscreteRod) -> list[Array]:
    """Return the parameters (n_c, N) of each placed kernel of the equations of equilibrium."""
    equations = rod.layout.equations
    placed = zip(equations.terms, equations.slices, strict=True)
    return [rod.p[part].reshape(term.count, -1).T for term, part in placed]


def equilibrium_scales(rod: DiscreteRod) -> tuple[Array, Array]:
    """Return the scales of the states and of the equations of equilibrium (n_states,)."""
    layout, L = rod.layout, rod.arm.length
    n_nodes = rod.mesh.s.size
    R = rod.arm.radius.evaluate(np.concatenate([rod.mesh.s, rod.s]), L)[0]
    EA = rod.arm.material.E * np.pi * R**2
    EJ = EA * R**2 / 4
    # Pose, moment and force; then the variables of the rod terms. Tendon states are of order 1.
    pose = np.tile(np.repeat([1.0, L], [4, 3]), (n_nodes, 1))
    wrench = np.repeat(EJ[:n_nodes, None] / [L, L**2], 3, axis=1)[:, : layout.structure.n_wrench]
    nodes = layout.nodes[:, : POSE + layout.structure.n_wrench]
    is_curvature = np.arange(layout.structure.n_strains) < 2 + layout.structure.law.torsion
    state, row = np.ones(layout.n_states), np.ones(layout.n_states)
    state[nodes] = row[nodes] = np.hstack([pose, wrench])
    state[layout.stages] = np.where(is_curvature, 1 / L, 1.0)
    row[layout.stages] = np.where(is_curvature, EJ[n_nodes:, None] / L, EA[n_nodes:, None])
    for term, places in zip(rod.section_terms, layout.stage_variables, strict=True):
        scales = term.stage_scales(rod.arm, state[layout.stages], row[layout.stages])
        state[places], row[places] = scales
    for terms, groups in zip(rod.node_terms, layout.node_variables, strict=True):
        for term, places in zip(terms, groups, strict=True):
            state[places], row[places] = term.node_scales(rod.arm)
    return state, row


@dataclass(frozen=True)
class LeastStretch(Block):
    """A lower bound on the stretch at the thinnest place of each segment with tendons.

    Attributes
    ----------
    layout : Layout
    thinnest : tuple of (int, int)
        In each segment, the element and its end, 0 or 1, at which the body is thinnest; empty
        without extension.
    s : tuple of float
        Arc lengths of these places, inside of their elements: strains jump at anchorages [m].
    """

    layout: Layout
    thinnest: tuple[tuple[int, int], ...]
    s: tuple[float, ...] = field(compare=False)

    @classmethod
    def of(cls, rod: DiscreteRod) -> LeastStretch:
        """Return the block of a rod."""
        mesh, thinnest = rod.mesh, list[tuple[int, int]]()
        radius = rod.arm.radius.evaluate(mesh.s, rod.arm.length)[0]
        crossed = np.unique(mesh.active[mesh.active > 0])
        for n_active in crossed if rod.layout.structure.law.extension else ():
            segment = np.flatnonzero(mesh.active == n_active)
            k, end = divmod(int(radius[segment[:, None] + [0, 1]].argmin()), 2)
            thinnest.append((int(segment[k]), end))
        inside = 1e-9 * rod.arm.length
        s = [float(mesh.s[k + end]) + inside * (1 - 2 * end) for k, end in thinnest]
        return cls(rod.layout, tuple(thinnest), tuple(s))

    @property
    def n_measured(self) -> int:
        """See Block."""
        return len(self.thinnest)

    def measure(self, states: ca.MX, dependents: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return 1 + q at the thinnest places, from the polynomials through the stages."""
        law, m = self.layout.structure.law, self.layout.structure.stages
        stretches = [ca.MX(0, 1)]
        for element, end in self.thinnest:
            places = self.layout.stages[element * m : (element + 1) * m, 2 + law.torsion]
            weights = ca.DM(gauss(m).at(float(end)))
            stretches.append(ca.dot(weights, states[places.tolist()]) + 1 - law.along_at_rest)
        return ca.vertcat(*stretches)

    def parts(self, view: ProgramView) -> Parts:
        """Return 1 + q >= PLANNED_STRETCH."""
        return Parts([Rows(STRETCH, view.measured, PLANNED_STRETCH)])

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the stretches of a shape; those far from collapse as they are on the mesh."""
        stretches = on_mesh.copy()
        near = stretches <= FAR_FROM_COLLAPSE
        if near.any():
            stretches[near] = 1 + shape.strain(np.array(self.s)[near])[:, 3]
        return stretches


@dataclass(frozen=True)
class PeakTension(Block):
    """The largest tension T_max over T_ref, which is the effort of the infinity norm."""

    n_decisions = 1

    def parts(self, view: ProgramView) -> Parts:
        """Return T_max - T >= 0."""
        # CasADi loses derivatives of a scalar minus a vector with respect to the scalar.
        T_max = ca.repmat(view.decisions, view.T.numel(), 1)
        return Parts([Rows(PEAK, T_max - view.T)])

    def initial_decisions(self, T: Array) -> Array:
        """Return the largest of the tensions."""
        return np.array([T.max()])


@dataclass(frozen=True)
class TotalPull(Block):
    """An upper limit on the sum of all tensions [N]."""

    limit: float = field(compare=False)
    n_parameters = 1

    def parameters(self) -> Array:
        """Return the limit."""
        return np.array([self.limit])

    def parts(self, view: ProgramView) -> Parts:
        """Return (limit - sum T) / T_ref >= 0."""
        return Parts([Rows(TOTAL_PULL, view.parameters / view.T_ref - ca.sum1(view.T))])


@dataclass(frozen=True)
class Responses(Block):
    """Responses of the rod to small forces on the tip, for the compliance of a target.

    A response is the change Y of all unknowns of the rod: the equations of equilibrium are
    linearised along Y. Tensions, or the lengths of the tendons, are constant.

    Attributes
    ----------
    layout : Layout
    request : ComplianceRequest
    directions : (3, width)
        Directions of the forces.
    force : float
        Magnitude of the forces [N].
    """

    layout: Layout
    request: ComplianceRequest
    directions: Array = field(compare=False)
    force: float = field(compare=False)

    @property
    def n_dependents(self) -> int:
        """See Block."""
        return self.request.width * self.layout.n_x

    @property
    def n_measured(self) -> int:
        """See Block."""
        return self.request.width**2

    @property
    def n_parameters(self) -> int:
        """See Block."""
        return 3 * self.request.width + 1

    def parameters(self) -> Array:
        """Return directions, column by column, and magnitude of the forces."""
        return np.append(self.directions.ravel("F"), self.force)

    def equations(self, rod: Places, unknown: int, row: int) -> list[Term]:
        """Return the linearised equations of each response."""
        shifts = np.arange(self.request.width) * self.layout.n_x
        each = [self._response(rod, unknown + shift, row + shift) for shift in shifts.tolist()]
        return [term for terms in each for term in terms]

    def _response(self, rod: Places, unknown: int, row: int) -> list[Term]:
        """Return equilibrium, then the constant load factor, lengths and tensions."""
        layout, terms = self.layout, list[Term]()
        for term in layout.equations.terms:
            unknowns = np.vstack([rod[term.unknowns], unknown + term.unknowns])
            terms.append(Term(linearised(term.kernel), unknowns, row + term.rows))
        n, row = layout.n_tendons, row + layout.n_states
        load = np.array([[n]])
        terms.append(Term(cached(_product), unknown + load, row + load))
        if self.request.hold == "length":
            (lengths,) = layout.lengths.terms
            changes = unknown + lengths.unknowns, unknown + lengths.rows
            unknowns = np.vstack([rod[lengths.unknowns], *changes, rod[lengths.rows]])
            kernel = cached(_locked_tendon, layout.structure.law)
            terms.append(Term(kernel, unknowns, row + lengths.rows))
        tensions = np.arange(n)[None, :]
        return [*terms, Term(cached(_product), unknown + tensions, row + tensions)]

    def kernel_parameters(self, rod: DiscreteRod) -> list[Array]:
        """See Block. The force is a change of the dead force on the elements."""
        columns, of_rod = list[Array](), equilibrium_parameters(rod)
        for direction in self.directions.T:
            for term, values in zip(rod.layout.equations.terms, of_rod, strict=True):
                change = np.zeros_like(values)
                if term.kernel.name == "element":
                    change[term.kernel.slices["force"]] = self.force * direction[:, None]
                columns.append(np.vstack([values, change]))
            columns.append(np.ones((1, 1)))
            factor = 1.0
            if self.request.hold == "length":
                lengths, EA = rod.length_p.reshape(-1, 5).T, self.request.tendon_EA
                compliance = np.full((1, lengths.shape[1]), 0.0 if EA is None else 1 / EA)
                columns.append(np.vstack([lengths, compliance]))
                factor = -least_compliance(rod.arm)
            columns.append(np.full((1, self.layout.n_tendons), factor))
        return columns

    def scales(self, rod: DiscreteRod) -> tuple[Array, Array]:
        """See Block."""
        state, row = equilibrium_scales(rod)
        force, n, width = rod.arm.bending_force, self.layout.n_tendons, self.request.width
        length = rod.arm.length if self.request.hold == "length" else force
        unknowns = np.concatenate([np.full(n + 1, force), state])
        rows = np.concatenate([row, np.full(n, length), [1.0]])
        return np.tile(unknowns, width), np.tile(rows, width)

    def measure(self, states: ca.MX, dependents: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return the compliance D^T Y_tip / force, column by column [m/N]."""
        width = self.request.width
        D = ca.reshape(parameters[: 3 * width], 3, width)
        Y = ca.reshape(dependents, self.layout.n_x, width)
        tip = self.layout.n_before_states + self.layout.nodes[-1, 4:POSE]
        return ca.vec(D.T @ Y[tip.tolist(), :] / parameters[-1])

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the compliance of a shape."""
        return tip_compliance(shape, self.request, self.directions).ravel()

    def measurement_scales(self, arm: Arm) -> Array:
        """See Block."""
        return np.full(self.n_measured, arm.length / arm.bending_force)


def _locked_tendon(law: CrossSection) -> Kernel:
    """Return the kernel of a locked tendon: change of its path minus change of its own length.

    Unknowns: strains, their changes, change of the tension, tension. Parameters: path and weight,
    1 / EA of the tendon, which is as long as its path under its tension.
    """
    kernel = cached(tendon_length, law)
    change = ca.SX.sym("change", size(law))
    tension_change, tension = ca.SX.sym("tension_change"), ca.SX.sym("tension")
    compliance = ca.SX.sym("compliance")
    stretch = kernel.r * compliance / (1 + compliance * tension)
    r = ca.jtimes(kernel.r, kernel.y, change) - stretch * tension_change
    y = ca.vertcat(kernel.y, change, tension_change, tension)
    return Kernel("locked", y, kernel.parameters | {"compliance": compliance}, r)


@dataclass(frozen=True)
class LeastMode(Block):
    """A lower bound on the eigenvalue sigma of the least stable mode y.

    y is a change of the states with dr/dS y = sigma B y, and sigma an eigenvalue of the scaled
    Hessian of the energy (octoplan.model.equilibrium.stability): 1 at rest, 0 at buckling.

    Attributes
    ----------
    layout : Layout
    margin : float
        Least eigenvalue.
    """

    layout: Layout
    margin: float = field(compare=False)
    n_measured = 1
    is_linear = False

    @property
    def n_dependents(self) -> int:
        """See Block."""
        return self.layout.n_states + 1

    def equations(self, rod: Places, unknown: int, row: int) -> list[Term]:
        """Return dr/dS y - sigma B y, and the norm of y."""
        layout, terms = self.layout, list[Term]()
        for term in layout.equations.terms:
            changing = tuple(np.flatnonzero(term.unknowns[:, 0] >= layout.n_before_states).tolist())
            changes = unknown + term.unknowns[list(changing)] - layout.n_before_states
            unknowns = np.vstack([rod[term.unknowns], changes])
            kernel = linearised_in(term.kernel, changing)
            terms.append(Term(kernel, unknowns, row + term.rows))
        strains, last = np.ravel(layout.stages), layout.n_states
        products = np.stack([np.full(strains.size, unknown + last), unknown + strains])
        norm = np.full((1, strains.size), row + last)
        terms.append(Term(cached(_mode_stiffness), products, row + strains[None, :]))
        terms.append(Term(cached(_mode_norm), unknown + strains[None, :], norm))
        return terms

    def kernel_parameters(self, rod: DiscreteRod) -> list[Array]:
        """See Block. Those of the norm follow the iterate, see `kernel_updates`."""
        stiffness = rest_stiffness(rod)[1]
        norm = np.zeros((2, stiffness.size))
        return [*equilibrium_parameters(rod), -stiffness[None, :], norm]

    def kernel_updates(self, rod: DiscreteRod, dependents: Array) -> ParameterValues:
        """Return the weights of the norm: the mode's projection on the mode of the iterate is 1.

        Modes are orthogonal with respect to B, so that no other mode satisfies this equation.
        """
        strains = dependents[np.ravel(self.layout.stages)]
        B_y = rest_stiffness(rod)[1] * strains
        weight = B_y / (B_y @ strains)
        return {"mode_norm": {"weight": weight, "share": np.full(B_y.size, 1 / B_y.size)}}

    def scales(self, rod: DiscreteRod) -> tuple[Array, Array]:
        """See Block."""
        state, row = equilibrium_scales(rod)
        return np.append(state, 1.0), np.append(row, 1.0)

    def measure(self, states: ca.MX, dependents: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return sigma."""
        return dependents[-1]

    def parts(self, view: ProgramView) -> Parts:
        """Return sigma >= margin."""
        return Parts([Rows(STABILITY, view.measured)])

    def bounds(self) -> Mapping[str, tuple[Array | float, Array | float]]:
        """Return the margin as lower bound."""
        return {STABILITY: (self.margin, np.inf)}

    def initial_dependents(self, equilibrium: Equilibrium) -> Array:
        """Return mode and eigenvalue of an equilibrium; the scaled strains have norm 1."""
        rod, strains = equilibrium.system, np.ravel(self.layout.stages)
        values, y = least_modes(equilibrium, 1)
        scaled = y[strains, 0] / equilibrium_scales(rod)[0][strains]
        norm = np.sqrt(rest_stiffness(rod)[0] / rod.arm.length @ scaled**2)
        return np.append(y[:, 0] / norm, values)

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the stability of a shape."""
        return np.array([shape.stability])


def _mode_stiffness() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiffness = ca.SX.sym("y", 2), ca.SX.sym("stiffness")
    return Kernel("mode_stiffness", y, {"stiffness": stiffness}, stiffness * y[0] * y[1])


def _mode_norm() -> Kernel:
    """Return the kernel of one term of the norm of a mode, minus its share of the norm 1."""
    y = ca.SX.sym("y")
    weight = ca.SX.sym("weight")
    share = ca.SX.sym("share")
    return Kernel("mode_norm", y, {"weight": weight, "share": share}, weight * y - share)


@dataclass(frozen=True)
class TendonLengths(Block):
    """Limits on the lengths of the tendons over the arm's length.

    Attributes
    ----------
    layout : Layout
    arm_length : float
        [m].
    lower, upper : (n_tendons,)
        l_min and l_max over the arm's length.
    """

    layout: Layout
    arm_length: float = field(compare=False)
    lower: Array = field(compare=False)
    upper: Array = field(compare=False)
    n_parameters = 1

    @property
    def n_dependents(self) -> int:
        """See Block."""
        return self.layout.n_tendons

    @property
    def n_measured(self) -> int:
        """See Block."""
        return self.layout.n_tendons

    def parameters(self) -> Array:
        """Return the arm's length."""
        return np.array([self.arm_length])

    def equations(self, rod: Places, unknown: int, row: int) -> list[Term]:
        """Return the integral of |c_j'|, minus l_j."""
        (runs,) = self.layout.lengths.terms
        each = np.arange(self.n_dependents)[None, :]
        path = Term(runs.kernel, rod[runs.unknowns], row + runs.rows)
        return [path, Term(cached(_product), unknown + each, row + each)]

    def kernel_parameters(self, rod: DiscreteRod) -> list[Array]:
        """See Block."""
        return [rod.length_p.reshape(-1, 5).T, np.full((1, self.n_dependents), -1.0)]

    def scales(self, rod: DiscreteRod) -> tuple[Array, Array]:
        """Return the arm's length."""
        length = np.full(self.n_dependents, rod.arm.length)
        return length, length

    def measure(self, states: ca.MX, dependents: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return the lengths over the arm's length."""
        return dependents / parameters

    def parts(self, view: ProgramView) -> Parts:
        """Return l_min <= l <= l_max."""
        return Parts([Rows(STROKES, view.measured, -np.inf)])

    def bounds(self) -> Mapping[str, tuple[Array | float, Array | float]]:
        """Return l_min and l_max."""
        return {STROKES: (self.lower, self.upper)}

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the lengths of the tendons of a shape over the arm's length."""
        return np.asarray(shape.tendon_lengths / shape.arm.length)


def _product() -> Kernel:
    """Return the kernel of a parameter times an unknown."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c")
    return Kernel("product", y, {"factor": c}, c * y)
