"""Blocks with the linearised equations of equilibrium: compliance of the tip, least stable mode.

    responses Y:                dr/dx Y + dr/dp f = 0,      compliance D^T Y_tip / |f|
    mode z, eigenvalue sigma:   dr/dS z - sigma B z = 0,    |z| = 1,    sigma >= margin

r are the equations of equilibrium, x their unknowns (tensions, load factor, states), S the states
of the rod, f a small force on the tip, D its directions, and B the stiffness of the body at rest.
The products are assembled from linearised kernels: with r(y, c) a kernel, its linearised kernel is
r'(y, dy, c, dc) = dr/dy dy + dr/dc dc, whose directions are further unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.modes import least_modes
from octoplan.model.equilibrium.stability import rest_stiffness
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import ParameterValues, PlacedKernel
from octoplan.model.rod.kernels import Kernel, Places, What
from octoplan.model.rod.layout import Layout
from octoplan.model.rotations import POSE
from octoplan.model.shape import Shape
from octoplan.model.support.machine.functions import cached
from octoplan.model.tendons import least_compliance
from octoplan.planner.block import ACTIVE, Block, Parts, ProgramView, Rows
from octoplan.planner.blocks import (
    equilibrium_parameters,
    equilibrium_scales,
    length_parameters,
    product,
)
from octoplan.planner.targets.base import ComplianceRequest
from octoplan.planner.targets.target_set import tip_compliance

# Kind of the row of the stability margin.
STABILITY = "stability"


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

    def equations(self, rod: Places, unknown: int, row: int) -> list[PlacedKernel]:
        """Return the linearised equations of each response."""
        shifts = np.arange(self.request.width) * self.layout.n_x
        each = [self._response(rod, unknown + shift, row + shift) for shift in shifts.tolist()]
        return [term for terms in each for term in terms]

    def _response(self, rod: Places, unknown: int, row: int) -> list[PlacedKernel]:
        """Return equilibrium, then the constant load factor, lengths and tensions."""
        layout, terms = self.layout, list[PlacedKernel]()
        for term in layout.equations.terms:
            unknowns = np.vstack([rod[term.unknowns], unknown + term.unknowns])
            terms.append(PlacedKernel(linearised(term.kernel), unknowns, row + term.rows))
        n, row = layout.n_tendons, row + layout.n_states
        load = np.array([[n]])
        terms.append(PlacedKernel(cached(product), unknown + load, row + load))
        if self.request.hold == "length":
            for lengths in layout.lengths.terms:
                changes = unknown + lengths.unknowns, unknown + lengths.rows
                unknowns = np.vstack([rod[lengths.unknowns], *changes, rod[lengths.rows]])
                terms.append(PlacedKernel(_locked(lengths.kernel), unknowns, row + lengths.rows))
        tensions = np.arange(n)[None, :]
        return [*terms, PlacedKernel(cached(product), unknown + tensions, row + tensions)]

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


@dataclass(frozen=True)
class LeastMode(Block):
    """A lower bound on the eigenvalue sigma of the least stable mode z.

    z is a change of the states with dr/dS z = sigma B z, and sigma an eigenvalue of the scaled
    Hessian of the energy (octoplan.model.equilibrium.stability): 1 at rest, 0 at buckling.

    Attributes
    ----------
    layout : Layout
    margin : float
        Least eigenvalue that is allowed: NlpOptions.stability_bound.
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

    def equations(self, rod: Places, unknown: int, row: int) -> list[PlacedKernel]:
        """Return dr/dS z - sigma B z, and the norm of z."""
        layout, terms = self.layout, list[PlacedKernel]()
        for term in layout.equations.terms:
            changing = tuple(np.flatnonzero(term.unknowns[:, 0] >= layout.n_before_states).tolist())
            changes = unknown + term.unknowns[list(changing)] - layout.n_before_states
            unknowns = np.vstack([rod[term.unknowns], changes])
            kernel = linearised_in(term.kernel, changing)
            terms.append(PlacedKernel(kernel, unknowns, row + term.rows))
        strains, last = np.ravel(layout.stages), layout.n_states
        products = np.stack([np.full(strains.size, unknown + last), unknown + strains])
        norm = np.full((1, strains.size), row + last)
        terms.append(PlacedKernel(cached(_mode_stiffness), products, row + strains[None, :]))
        terms.append(PlacedKernel(cached(_mode_norm), unknown + strains[None, :], norm))
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


class LinearisedKernel(Kernel):
    """The derivative of a kernel along changes of some unknowns, and of the parameters.

    Attributes
    ----------
    kernel : Kernel
        The kernel r(y, c).
    change_of : (n_y,) of int
        Place of the change of each unknown among all unknowns, which begin with y; -1 for unknowns
        that do not change.
    """

    def __init__(
        self, name: str, kernel: Kernel, changing: tuple[int, ...], parameters_change: bool
    ) -> None:
        self.kernel = kernel
        n = kernel.y.numel()
        dy = ca.SX.sym("dy", len(changing))
        dc = ca.SX.sym("dc", kernel.c.numel() * parameters_change)
        self.change_of = np.full(n, -1, dtype=np.int64)
        self.change_of[list(changing)] = n + np.arange(len(changing))
        self._dy = ca.SX.zeros(n)
        self._dy[list(changing)] = dy
        self._dc = dc if parameters_change else ca.SX.zeros(kernel.c.numel())
        y = ca.vertcat(kernel.y, dy)
        parameters = kernel.parameters | {"dc": dc}
        super().__init__(name, y, parameters, self._directional_derivative(kernel.r))

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """See Kernel. With the kernel's J and H: (J', J) and r', or ((H', H), (H, 0))."""
        if what == "parameter_jacobian":
            return super()._differentiated(what)
        is_hessian = what == "hessian"
        lam = ca.SX.sym("lam", self.r.numel())
        function, i, j = self.kernel.derivative(what)
        nonzeros = function.call([self.kernel.y, self.kernel.c, lam][: 2 + is_hessian])[0]
        rates = ca.sparsify(self._directional_derivative(nonzeros))
        changed = np.array(rates.sparsity().row(), dtype=np.int64)
        mixed = np.flatnonzero(self.change_of[j] >= 0)
        mixed_values = nonzeros[mixed.tolist()]
        change = self.change_of[j[mixed]]
        rows = [i[changed], i[mixed]]
        columns = [j[changed], change]
        values = [ca.vec(rates.nz[:]), mixed_values]
        if is_hessian:
            rows.append(change)
            columns.append(i[mixed])
            values.append(mixed_values)
        inputs = [self.y, self.c, lam][: 2 + is_hessian]
        # Kernel and derivatives share common subexpressions already.
        results = [ca.densify(ca.vertcat(*values)), *[self.r] * (what == "jacobian")]
        derivative = ca.Function(f"{self.name}_{what}", inputs, results)
        return derivative, np.concatenate(rows), np.concatenate(columns)

    def _directional_derivative(self, expression: ca.SX) -> ca.SX:
        by_unknowns = ca.jtimes(expression, self.kernel.y, self._dy)
        return by_unknowns + ca.jtimes(expression, self.kernel.c, self._dc)


def linearised(kernel: Kernel) -> LinearisedKernel:
    """Return the derivative of a kernel along changes of all unknowns and parameters."""
    every = tuple(range(kernel.y.numel()))
    return cached(LinearisedKernel, f"{kernel.name}_linearised", kernel, every, True)


def linearised_in(kernel: Kernel, changing: tuple[int, ...]) -> LinearisedKernel:
    """Return the derivative of a kernel along changes of the unknowns at some places."""
    return cached(LinearisedKernel, f"{kernel.name}_mode", kernel, changing, False)
