"""The block of the tip's compliance: responses of the rod to small forces on the tip.

    unknowns Y:    dr/dx Y + dr/dp f = 0,    compliance D^T Y_tip / |f|

r are the equations of equilibrium, x their unknowns (tensions, load factor, states), f a small
force on the tip and D its directions. The products are assembled from linearised kernels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import Term
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.nodes import POSE
from octoplan.model.shape import Shape
from octoplan.model.support.machine.functions import cached
from octoplan.model.tendons import least_compliance
from octoplan.planner.block import Block
from octoplan.planner.blocks import (
    equilibrium_parameters,
    equilibrium_scales,
    length_parameters,
    product,
)
from octoplan.planner.linearised_kernel import linearised
from octoplan.planner.targets.base import ComplianceRequest
from octoplan.planner.targets.target_set import tip_compliance


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
        terms.append(Term(cached(product), unknown + load, row + load))
        if self.request.hold == "length":
            for lengths in layout.lengths.terms:
                changes = unknown + lengths.unknowns, unknown + lengths.rows
                unknowns = np.vstack([rod[lengths.unknowns], *changes, rod[lengths.rows]])
                terms.append(Term(_locked(lengths.kernel), unknowns, row + lengths.rows))
        tensions = np.arange(n)[None, :]
        return [*terms, Term(cached(product), unknown + tensions, row + tensions)]

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
                EA = self.request.tendon_EA
                for lengths in length_parameters(rod):
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

    def compliances(self, measured: ca.MX) -> ca.MX:
        """Return the measurements, which are compliances."""
        return measured

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the compliance of a shape."""
        return tip_compliance(shape, self.request, self.directions).ravel()

    def measurement_scales(self, arm: Arm) -> Array:
        """See Block."""
        return np.full(self.n_measured, arm.length / arm.bending_force)


@cache
def _locked(kernel: Kernel) -> Kernel:
    """Return the kernel of a locked tendon: change of its path minus change of its own length.

    Unknowns: those of the kernel of a length, their changes, change of the tension, tension.
    Parameters: those of the kernel, 1 / EA of the tendon. Under the tension, the tendon is as long
    as the path.
    """
    change = ca.SX.sym("change", kernel.y.numel())
    tension_change, tension = ca.SX.sym("tension_change"), ca.SX.sym("tension")
    compliance = ca.SX.sym("compliance")
    stretch = kernel.r * compliance / (1 + compliance * tension)
    r = ca.jtimes(kernel.r, kernel.y, change) - stretch * tension_change
    y = ca.vertcat(kernel.y, change, tension_change, tension)
    return Kernel(f"locked_{kernel.name}", y, kernel.parameters | {"compliance": compliance}, r)
