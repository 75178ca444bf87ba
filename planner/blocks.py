"""Blocks of the program: least stretch, limits of tensions, lengths of the tendons.

    least stretch     1 + q >= 1e-3, at one place of each segment; only with extension
    largest tension   unknown T_peak:   T_peak - T_j >= 0
    total pull        sum_j T_j <= limit
    tendon lengths    unknowns l_j:     integral of |c_j| - l_j = 0,    l_min <= l_j <= l_max

c_j is the tangent of tendon j per unit of arc length. octoplan.planner.linearised_blocks has the
larger blocks: compliance of the tip, and stability margin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import PlacedKernel
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.layout import Layout
from octoplan.model.rotations import POSE
from octoplan.model.shape import Shape
from octoplan.model.support.machine.functions import cached
from octoplan.planner.block import ACTIVE, Block, Parts, ProgramView, Rows

# Kinds of rows.
STRETCH = "stretch"
PEAK = "peak"
TOTAL_PULL = "total pull"
STROKES = "strokes"
# Name of the collapse of the body among active limits.
CRUSHED = "the body, which would be crushed (1 + q at its least)"
# Least stretch 1 + q of a plan [-].
PLANNED_STRETCH = 1e-3
# Stretch above which a cross-section is far from collapse, so that no defect is added [-].
FAR_FROM_COLLAPSE = 0.1


def equilibrium_parameters(rod: DiscreteRod) -> list[Array]:
    """Return the parameters (n_c, N) of each placed kernel of the equations of equilibrium."""
    equations = rod.layout.equations
    placed = zip(equations.terms, equations.slices, strict=True)
    return [rod.p[part].reshape(term.count, -1).T for term, part in placed]


def length_parameters(rod: DiscreteRod) -> list[Array]:
    """Return the parameters (n_c, N) of each placed kernel of the lengths of the tendons."""
    lengths = rod.layout.lengths
    placed = zip(lengths.terms, lengths.slices, strict=True)
    return [rod.length_p[part].reshape(term.count, -1).T for term, part in placed]


def equilibrium_scales(rod: DiscreteRod) -> tuple[Array, Array]:
    """Return the scales of the states and of the equations of equilibrium (n_states,)."""
    layout, L = rod.layout, rod.arm.length
    n_nodes = rod.mesh.s.size
    EA, EJn, EJb, _ = rod.arm.section_stiffness(np.concatenate([rod.mesh.s, rod.s]))[0]
    EJ = np.sqrt(EJn * EJb)
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
        In each segment, the element and the end, 0 or 1, at which the body is thinnest; empty
        without extension.
    s : tuple of float
        Arc lengths of the thinnest places, inside of the elements: strains jump at anchorages [m].
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

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return the collapse of the body, if some multiplier is not zero."""
        is_active = multipliers(STRETCH).min(initial=0.0) < -ACTIVE
        return [(np.inf, CRUSHED)] if is_active else []

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the stretches of a shape; stretches far from collapse as on the mesh."""
        stretches = on_mesh.copy()
        near = stretches <= FAR_FROM_COLLAPSE
        if near.any():
            stretches[near] = 1 + shape.strain(np.array(self.s)[near])[:, 3]
        return stretches


@dataclass(frozen=True)
class PeakTension(Block):
    """The largest tension T_peak over T_ref, which is the effort of the infinity norm."""

    n_decisions = 1

    def parts(self, view: ProgramView) -> Parts:
        """Return T_peak - T >= 0, and T_peak as the effort."""
        # CasADi loses derivatives of a scalar minus a vector with respect to the scalar.
        T_peak = ca.repmat(view.decisions, view.T.numel(), 1)
        return Parts([Rows(PEAK, T_peak - view.T)], effort=view.decisions)

    def initial_decisions(self, T: Array, states: Array) -> Array:
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
class TendonLengths(Block):
    """Limits on the lengths of the tendons over the arm's length.

    Attributes
    ----------
    layout : Layout
    arm_length : float
        [m].
    zero : (n_tendons,)
        Lengths of the tendons at stroke 0 [m].
    strokes : (2, n_tendons)
        Smallest and largest strokes [m]: l_max = zero - smallest, l_min = zero - largest.
    """

    layout: Layout
    arm_length: float = field(compare=False)
    zero: Array = field(compare=False)
    strokes: Array = field(compare=False)
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

    def equations(self, rod: Places, unknown: int, row: int) -> list[PlacedKernel]:
        """Return the length of the path of each tendon, minus l_j."""
        each = np.arange(self.n_dependents)[None, :]
        paths = [
            PlacedKernel(term.kernel, rod[term.unknowns], row + term.rows)
            for term in self.layout.lengths.terms
        ]
        return [*paths, PlacedKernel(cached(product), unknown + each, row + each)]

    def kernel_parameters(self, rod: DiscreteRod) -> list[Array]:
        """See Block."""
        return [*length_parameters(rod), np.full((1, self.n_dependents), -1.0)]

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
        """Return l_min and l_max over the arm's length."""
        upper, lower = (self.zero - self.strokes) / self.arm_length
        return {STROKES: (lower, upper)}

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return each stroke whose multiplier is not zero."""
        active, lam = list[tuple[float, str]](), multipliers(STROKES)
        for j in np.flatnonzero(np.abs(lam) > ACTIVE).tolist():
            end = 1e3 * self.strokes[int(lam[j] < 0), j]
            active.append((abs(lam[j]), f"the stroke of {arm.tendon_name(j)}, at {end:g} mm"))
        return active

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the lengths of the tendons of a shape over the arm's length."""
        return np.asarray(shape.tendon_lengths / shape.arm.length)


def product() -> Kernel:
    """Return the kernel of a parameter times an unknown."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c")
    return Kernel("product", y, {"factor": c}, c * y)
