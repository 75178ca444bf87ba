"""The equilibrium of an arm on one mesh, as a value: equations linearised at the solution.

One factorisation serves the steps of Newton's method, and by the implicit function theorem all
derivatives of the equilibrium. States are ordered along the arm, so that the matrix is a narrow
band. `AnyEquilibrium` includes the explicit solution of an arm whose cross-sections are not
coupled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from octoplan.model.cross_section.sections import LEAST_STRETCH, Extremes, reported
from octoplan.model.equilibrium.explicit import ExplicitEquilibrium
from octoplan.model.mesh import Mesh
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import CollapsedError, SingularError, UnsettledSectionError

Index = NDArray[np.int64]
# The order in which loads and tensions acted. "near": both changed from those of another shape.
History = Literal["loads first", "tensions first", "near"]
# Smallest change of curvature times radius, or of stretch, between two stages that is a jump.
JUMP = 0.3
# Largest distance of two stages at a jump, relative to the radius of the body: a rod has no
# features of this size.
JUMP_WIDTH = 0.25


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The equations linearised at a point; derivatives and factors are computed when needed.

    The point is an equilibrium, or an iterate of Newton's method on the way to one.

    Attributes
    ----------
    system : DiscreteRod
    x : (n_x,)
        Tensions, load factor and states.
    linearised_at : Equilibrium
        Equations linearised nearby, whose Jacobian and factors are used, or None.
    jacobian : (nnz,)
        Known nonzeros of the Jacobian, or of another Jacobian, such as that of a
        stiffer body.
    history : History
        The order in which loads and tensions acted.
    snaps : tuple of float
        The load factors at which the arm jumped; () without contact.
    """

    system: DiscreteRod
    x: Array
    linearised_at: Equilibrium | None = None
    jacobian: Array | None = None
    history: History = "loads first"
    snaps: tuple[float, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return Equilibrium, (self.system, self.x, None, None, self.history)

    @cached_property
    def nonzeros(self) -> Array:
        """The nonzeros of the Jacobian (nnz,), in the places of `band`."""
        if self.linearised_at:
            return self.linearised_at.nonzeros
        if self.jacobian is not None:
            return self.jacobian
        return self.system.layout.equations.jacobian(self.x, self.system.p)[
            : -self.system.layout.n_states
        ]

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,)."""
        return self.x[: self.system.layout.n_tendons]

    @cached_property
    def states(self) -> Array:
        """The states (n_states,)."""
        return self.x[self.system.layout.n_before_states :]

    @cached_property
    def factor(self) -> tuple[Array, Array] | None:
        """The LU factors of the Jacobian by the states; None if singular."""
        if self.linearised_at:
            return self.linearised_at.factor
        band = self.system.layout.band
        stored = np.zeros(self.system.layout.n_states * band.height)
        stored[band.stored] = self.nonzeros[band.inside]
        columns = stored.reshape(-1, band.height).T
        factors, pivots, info = dgbtrf(columns, band.below, band.above, overwrite_ab=1)
        return None if info != 0 or not np.all(np.isfinite(factors)) else (factors, pivots)

    def solve(self, right: Array, transposed: bool = False) -> Array:
        """Return the changes of the states (n_states, ...) for right-hand sides (n_states, ...).

        With `transposed`, solve with the transposed Jacobian. Raise SingularError if the Jacobian
        is singular.
        """
        if self.factor is None:
            raise SingularError("the equations of equilibrium are singular: the arm buckles")
        factors, pivots = self.factor
        band = self.system.layout.band
        before = band.states if transposed else band.equations
        after = band.equations if transposed else band.states
        ordered = np.asfortranarray(right[before])
        solution, _ = dgbtrs(
            factors, band.below, band.above, ordered, pivots, int(transposed), overwrite_b=1
        )
        result: Array = np.empty_like(solution)
        result[after] = solution
        return result

    @cached_property
    def by_tensions(self) -> Array:
        """The derivatives of the states by the tensions (n_states, n_tendons)."""
        return self.by_unknowns(0, self.system.layout.n_tendons)

    def by_unknowns(self, first: int, last: int) -> Array:
        """Return the derivatives of the states (n_states, last - first) by some unknowns.

        The unknowns `first` to `last` - 1 are tensions and the load factor. Raise SingularError if
        the Jacobian is singular.
        """
        band = self.system.layout.band
        right = np.zeros((self.system.layout.n_states, last - first))
        selected = (band.columns >= first) & (band.columns < last)
        right[band.rows[selected], band.columns[selected] - first] = self.nonzeros[selected]
        return -self.solve(right)

    def relinearised(self) -> Equilibrium:
        """Return the equilibrium with derivatives at the own states, not at nearby states."""
        if self.linearised_at is None:
            return self
        return Equilibrium(self.system, self.x, history=self.history)

    def by_direction(self, direction: Array) -> Array:
        """Return the derivative of the states (n_states,) along a line.

        `direction` (n_tendons + 1,) are changes of tensions [N] and load factor. Raise
        SingularError if the Jacobian is singular.
        """
        band = self.system.layout.band
        right = np.zeros(self.system.layout.n_states)
        selected = band.columns < self.system.layout.n_before_states
        values = self.nonzeros[selected] * direction[band.columns[selected]]
        np.add.at(right, band.rows[selected], values)
        return -self.solve(right)

    @cached_property
    def lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""
        return self.system.lengths(self.x)

    @property
    def length_tension(self) -> Array:
        """The derivatives of the lengths by the tensions (n_tendons, n_tendons) [m/N]."""
        return np.asarray(self.system.length_jacobian(self.x) @ self.by_tensions)

    @property
    def mesh(self) -> Mesh:
        """The mesh of N elements."""
        return self.system.mesh

    @property
    def poses(self) -> Array:
        """Quaternions and positions [m] at the nodes (N + 1, 7)."""
        return self.states[self.system.layout.nodes[:, :POSE]]

    @cached_property
    def extremes(self) -> Extremes:
        """Extremes of the stretch at stages and ends of elements, and of curvature at stages."""
        layout = self.system.layout
        sections = self.system.sections
        s = self.system.mesh.s
        _, xi, k, q = reported(layout.structure.law, self.states[layout.stages])[:, :4].T
        method = gauss(layout.structure.stages)
        ends = method.at_ends @ q.reshape(layout.elements, -1).T
        places = np.concatenate([sections.s, s[:-1], s[1:]])
        radius = sections.stations.radius
        jump = _largest_jump(
            sections.s, radius, np.array([radius * xi, radius * k, q]), method.c.size
        )
        return Extremes.of(places, np.append(q, ends), np.hypot(xi, k), radius, jump)

    @property
    def scheme(self) -> str:
        """The name of the scheme."""
        return f"gauss{2 * self.system.layout.structure.stages}"

    @property
    def machine_code(self) -> bool:
        """Whether the kernels are compiled."""
        return self.system.layout.structure.machine_code

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return poses (K, 7) and strains on the base side of arc lengths s (K,) [m].

        Strains are tau, xi, k, q (K, 4), and with shear also nu_n, nu_b (K, 6).
        """
        # Nodes are sufficient to settle: only shapes that are evaluated between them integrate.
        from octoplan.model.equilibrium.integration import poses_and_strains

        poses, v = poses_and_strains(self.system, self.x, s)
        nodes = np.minimum(np.searchsorted(self.mesh.s, s), self.mesh.elements)
        exact = (self.mesh.s[nodes] == s)[:, None]
        law = self.system.layout.structure.law
        return np.where(exact, self.poses[nodes], poses), reported(law, v)


def linearised(
    system: DiscreteRod, x: Array, near: Sequence[Equilibrium | None]
) -> tuple[list[Equilibrium], Array]:
    """Return the equations linearised at points x (M, n_x), and their residuals (M, n_states).

    Points with an entry of `near` use the Jacobian and the factors of this entry.
    """
    n = system.layout.n_states
    alone = np.array([each is None for each in near], dtype=bool)
    jacobians = iter(np.zeros((0, 0)))
    residuals = np.empty((len(x), n))
    if alone.any():
        whole = system.layout.equations.jacobian(x[alone], system.p)
        jacobians = iter(whole[:, :-n])
        residuals[alone] = whole[:, -n:]
    if not alone.all():
        residuals[~alone] = system.residual(x[~alone])
    points = [
        Equilibrium(system, row, each, None if each else next(jacobians))
        for row, each in zip(x, near, strict=True)
    ]
    return points, residuals


def _largest_jump(s: Array, radius: Array, values: Array, stages: int) -> float | None:
    """Return the place of the largest jump inside an element [m]; None without a jump.

    `values` (3, N) are curvatures times radius, and stretch, at the stages s (N,). A cross-section
    may have two equilibria if it bends around a tendon, and the arm may change from one to the
    other. No mesh has a node at such a place, so that errors fall by order one.
    """
    change = np.abs(np.diff(values)).max(axis=0)
    is_inside = np.arange(1, s.size) % stages > 0
    is_near = np.diff(s) < JUMP_WIDTH * radius[1:]
    jumps = np.where(is_inside & is_near, change, 0.0)
    return float(s[jumps.argmax()]) if jumps.max(initial=0.0) > JUMP else None


AnyEquilibrium = Equilibrium | ExplicitEquilibrium


def check_stretch(equilibrium: AnyEquilibrium) -> None:
    """Raise an error if the least stretch is undefined or too small.

    UnsettledSectionError if a cross-section has no equilibrium; CollapsedError if 1 + q reaches 0.
    """
    s, stretch, *_ = equilibrium.extremes
    if math.isnan(stretch):
        raise UnsettledSectionError(s)
    if not stretch > LEAST_STRETCH:
        raise CollapsedError(s, stretch)
