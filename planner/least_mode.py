"""The block of the stability margin: the least stable mode and the eigenvalue.

    unknowns z, sigma:    dr/dS z - sigma B z = 0,    |z| = 1,    sigma >= margin

r are the equations of equilibrium, S the states of the rod, and B the stiffness of the body at
rest. The products are assembled from linearised kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.stability import least_modes, rest_stiffness
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import ParameterValues, Term
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.layout import Layout
from octoplan.model.shape import Shape
from octoplan.model.support.machine.functions import cached
from octoplan.planner.block import ACTIVE, Block, Parts, ProgramView, Rows
from octoplan.planner.blocks import equilibrium_parameters, equilibrium_scales
from octoplan.planner.linearised_kernel import linearised_in

# Kind of the row of the margin.
STABILITY = "stability"


@dataclass(frozen=True)
class LeastMode(Block):
    """A lower bound on the eigenvalue sigma of the least stable mode z.

    z is a change of the states with dr/dS z = sigma B z, and sigma an eigenvalue of the scaled
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
    mesh_reduces_defect = False

    @property
    def n_dependents(self) -> int:
        """See Block."""
        return self.layout.n_states + 1

    def equations(self, rod: Places, unknown: int, row: int) -> list[Term]:
        """Return dr/dS z - sigma B z, and the norm of z."""
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
        """See Block. `kernel_updates` replaces the parameters of the norm at each iterate."""
        stiffness = rest_stiffness(rod)[1]
        norm = np.zeros((2, stiffness.size))
        return [*equilibrium_parameters(rod), -stiffness[None, :], norm]

    def kernel_updates(self, rod: DiscreteRod, dependents: Array) -> ParameterValues:
        """Return the weights of the norm: the mode's projection on the mode of the iterate is 1.

        Modes are orthogonal with respect to B, so that no other mode satisfies this equation.
        """
        strains = dependents[np.ravel(self.layout.stages)]
        B_z = rest_stiffness(rod)[1] * strains
        weight = B_z / (B_z @ strains)
        return {"mode_norm": {"weight": weight, "share": np.full(B_z.size, 1 / B_z.size)}}

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
        values, z = least_modes(equilibrium, 1)
        scaled = z[strains, 0] / equilibrium_scales(rod)[0][strains]
        norm = np.sqrt(rest_stiffness(rod)[0] / rod.arm.length @ scaled**2)
        return np.append(z[:, 0] / norm, values)

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return the margin, if the multiplier is not zero."""
        is_active = multipliers(STABILITY).min(initial=0.0) < -ACTIVE
        return [(np.inf, active_margin(self.margin))] if is_active else []

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the stability of a shape."""
        return np.array([shape.stability])


def active_margin(margin: float) -> str:
    """Return the name of an active stability margin."""
    return f"stability, at its margin of {margin:g}"


def _mode_stiffness() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiffness = ca.SX.sym("y", 2), ca.SX.sym("stiffness")
    return Kernel("mode_stiffness", y, {"stiffness": stiffness}, stiffness * y[0] * y[1])


def _mode_norm() -> Kernel:
    """Return the kernel of one term of the norm of a mode, minus a share of the norm 1."""
    y = ca.SX.sym("y")
    weight = ca.SX.sym("weight")
    share = ca.SX.sym("share")
    return Kernel("mode_norm", y, {"weight": weight, "share": share}, weight * y - share)
