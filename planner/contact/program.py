"""Plans in contact as one nonlinear program: the arm's equations with complementarity at nodes.

    minimise    sum T^2 / 2 + the weight of soft residuals, and of slacks
    subject to  the equations of equilibrium, with the forces of contact P as states,
                P >= 0, gap >= 0, P gap <= eps        at each node, of each obstacle,
                equalities = 0, inequalities >= 0     of the targets, less slacks,
                forces on each object that is held balance its wrench, tangential ones f in cones:
                n . f = 0, f . f <= (mu P)^2,
                lower <= T <= upper, sum T <= total pull.

It is solved with eps to 0 on a mesh that knows nothing of the contacts (Scholtes, SIAM J. Optim.
11, 2001). On a mesh with nodes where a settled arm touches, what touches is set, and the rows of
these nodes are gap = 0, gap' = 0 with the place's shift along the arm as a state: then its optimum
is that of the arm itself once places stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.sparse import csc_array

from model.contact.touches import Touches, pressure_shares
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import least_modes
from model.loads import contacts
from model.paths import Array
from model.transcription.layout import POSE
from model.transcription.system import System
from model.transcription.touch import TOUCH
from planner.contact.rows import NEAREST, Structure, functions
from planner.program.limits import Limits, natural_tensions
from planner.program.problem import Bounds
from planner.program.program import factorised
from planner.program.states import mode_numbers, mode_size
from planner.program.terms import Same, stations_of
from planner.solve.ipopt import Solution, solved
from planner.targets.base import Target
from planner.targets.hold import LEVER, Hold
from planner.targets.wrap import CLEAR

# Rows and bounds that hold, in scaled units.
_ACTIVE = 1e-6


@dataclass(frozen=True, eq=False)
class Optimality:
    """The residual of the first-order conditions, and multipliers of tensions and stability."""

    residual: float
    lam_bounds: Array
    lam_stability: float


class Program:
    """The program of targets on a mesh of an arm in contact.

    Attributes
    ----------
    system : System
        With what touches; where that is nothing contacts are found by complementarity.
    """

    def __init__(
        self,
        system: System,
        targets: tuple[Target, ...],
        limits: Limits,
        least: float = 0.0,
        sharp: bool = False,
    ) -> None:
        self.system, self.targets, self.limits, self.least = system, targets, limits, least
        arm, of, mesh = system.arm, system.of, system.mesh
        self.bodies = [contact.obstacle for contact in contacts(system.scene)]
        holds = [target for target in targets if isinstance(target, Hold)]
        self.structure = Structure(
            of,
            tuple(mesh.node(s) for s in stations_of(arm, targets)),
            tuple((self.bodies.index(hold.obstacle), len(hold.wrench)) for hold in holds),
            tuple(target.structure(arm) for target in targets),
            int(least > 0),
            arm,
            Same(targets),
        )
        self.functions = functions(self.structure)
        self._of_holds, self.sharp = holds, sharp
        self.touches = Touches.of(system)
        self.force = float(np.max(natural_tensions(arm)))
        self.z_unit, self.row_unit = self._units()

    def _units(self) -> tuple[Array, Array]:
        """Return what one unit of each unknown, and of each equation, is worth."""
        system, of, at = self.system, self.system.of, self.structure
        L, n, held = system.arm.length, of.n_tendons, self.touches
        R = system.arm.radius.evaluate(np.concatenate([system.mesh.s, system.s]), L)[0]
        EA = system.arm.material.E * np.pi * R**2
        EJ, nodes = EA * R**2 / 4, system.mesh.s.size
        state, row = np.ones(of.n_states), np.ones(of.n_states)
        state[of.nodes[:, 4:POSE]] = row[of.nodes[:, 4:POSE]] = L
        for part in range(of.form.wrench // 3):
            own = of.nodes[:, POSE + 3 * part : POSE + 3 * part + 3]
            state[own] = row[own] = EJ[:nodes, None] / L ** (1 + part)
        curved = np.arange(of.form.strains) < 2 + of.form.law.torsion
        state[of.stages] = np.where(curved, 1 / L, 1.0)
        row[of.stages] = np.where(curved, EJ[nodes:, None] / L, EA[nodes:, None])
        P, p = of.touches[:, :, 0], of.touches[:, :, 1]
        lies = held.end | held.inside
        state[P], state[p] = self.force, np.where(lies, self.force / L, L)
        row[P] = np.where(held.held, L, self.force)
        row[p] = np.where(lies, L, np.where(held.moves, 1.0, L))
        mode = np.append(state, 1.0) if at.modes else np.zeros(0)
        unit = np.full(n, self.force)
        tangential = np.concatenate(
            [np.full(3 * of.elements, hold.size(system.arm)) for hold in self._of_holds]
            + [np.zeros(0)]
        )
        z = np.concatenate([unit, [1.0], state, tangential, mode])
        rows = np.ones(self.functions.equations.n_g)
        rows[: of.n_states] = row
        if at.modes:
            rows[self.functions.first_mode :] = np.append(row, 1.0)
        return np.append(z, np.ones(self.functions.n_slack)), rows

    @property
    def numbers(self) -> Array:
        """The numbers of the equations."""
        system, of, arm = self.system, self.system.of, self.system.arm
        own = [
            system.p[numbers].reshape(term.count, -1).T
            for term, numbers in zip(of.equations.terms, of.equations.slices, strict=True)
        ]
        N, K, L = of.elements, of.form.contacts, arm.length
        touch = system.p[of.equations.numbers_of("touch")].reshape(N * K, TOUCH).T
        found = [*own, np.vstack([touch, np.full((2, N * K), [[L], [self.force]])])]
        before, here, beyond = pressure_shares(system, self.touches.lies)
        for hold, (j, _) in zip(self._of_holds, self.structure.holds, strict=True):
            body = np.repeat(hold.obstacle.numbers[:, None], N, axis=1)
            held = self.touches.held if self.sharp else np.ones_like(self.touches.held)
            shares = [part[1:, j] for part in (held, before, here, beyond, self.touches.moves)]
            size_ = hold.size(arm)
            more = np.repeat([[hold.friction], [size_], [LEVER * L]], N, axis=1)
            found.append(np.vstack([body, *(own[None] for own in shares), more]))
        if self.structure.modes:
            found += [*own, *mode_numbers(system, self._strain_unit)]
        return np.concatenate([np.ravel(own, "F") for own in found])

    @property
    def _strain_unit(self) -> Array:
        return np.ravel(self.z_unit[self.system.of.first + self.system.of.stages])

    def bounds(self, eps: float, slacks: bool) -> tuple[Array, Array, Array, Array]:
        """Return those of unknowns and rows; products of force and gap up to `eps`."""
        at, of, f, n = self.structure, self.system.of, self.functions, self.system.of.n_tendons
        low, high = np.full(self.z_unit.size, -np.inf), np.full(self.z_unit.size, np.inf)
        low[:n], high[:n] = np.array(self.limits.lower), np.array(self.limits.upper)
        low[:n], high[:n] = low[:n] / self.z_unit[:n], high[:n] / self.z_unit[:n]
        low[n] = high[n] = 1.0
        low[at.n_y :] = high[at.n_y :] = 0.0
        if slacks:
            low[at.n_y :], high[at.n_y :] = -np.inf, np.inf
        P, p, held = of.touches[:, :, 0], of.touches[:, :, 1], self.touches
        low[of.first + P[held.held]] = 0.0
        low[of.first + p[held.end | held.inside]] = 0.0
        g_low, g_high = np.zeros(f.n_g), np.zeros(f.n_g)
        N, K = of.elements, of.form.contacts
        gaps = slice(of.n_states, of.n_states + N * K)
        products = slice(gaps.stop, gaps.stop + N * K)
        g_high[gaps] = np.inf
        g_low[products], g_high[products] = -np.inf, np.inf
        if not self.sharp:
            g_high[P[1:]], g_high[products] = np.inf, eps
        if self.sharp:
            g_low[gaps][np.ravel((held.held | held.inside)[1:])] = -np.inf
        for i, (cone, (j, _)) in enumerate(zip(f.cones, at.holds, strict=True)):
            g_high[cone] = np.inf
            if self.sharp:
                free = ~(held.held | held.inside)[1:, j]
                low[at.tangential[i, free]] = high[at.tangential[i, free]] = 0.0
                g_low[cone.start : cone.stop + N][np.tile(free, 2)] = -np.inf
                g_high[cone.start : cone.stop + N][np.tile(free, 2)] = np.inf
        for hold, wrench in zip(self._of_holds, f.wrenches, strict=True):
            scaled = np.array(hold.wrench) / hold.size(self.system.arm)
            scaled[3:] /= LEVER * self.system.arm.length
            g_low[wrench] = g_high[wrench] = -scaled
        g_high[f.inequalities] = np.inf
        clear = [k for k, name in enumerate(f.names) if name == CLEAR]
        g_low[f.inequalities.start + np.array(clear, dtype=int)] = -np.inf
        g_low[-1], g_high[-1] = -np.inf, np.inf
        if self.limits.total is not None:
            g_high[-1] = self.limits.total / self.force
        if at.modes:
            low[at.n_y - 1] = self.least
        return low, high, g_low, g_high

    def parameters(self, slacks: bool) -> Array:
        """Return the parameters."""
        given = np.concatenate([t.parameters(self.system.arm) for t in self.targets])
        weights = [NEAREST * slacks]
        return np.concatenate([self.z_unit, self.row_unit, self.numbers, given, weights])

    def guess(self, tensions: Array, states: Array) -> Array:
        """Return unknowns at tensions (n_tendons,) and states (n_states,)."""
        z, n = np.zeros(self.z_unit.size), self.system.of.n_tendons
        z[:n], z[n] = tensions, 1.0
        z[self.system.of.first : self.system.of.n_x] = states
        if self.structure.modes:
            here = Linearised(self.system, self.system.x(tensions, 1.0, states))
            values, y = least_modes(here, 1)
            y = mode_size(self.system, self._strain_unit, y)
            z[self.structure.mode : self.structure.n_y] = np.append(y, values)
        return z / self.z_unit

    @property
    def tangential(self) -> slice:
        """Where tangential forces on what is held are among the unknowns."""
        return slice(self.system.of.n_x, self.structure.mode)

    def tensions(self, z: Array) -> Array:
        """Return those in unknowns, within limits to the last digit (n_tendons,) [N]."""
        n = self.system.of.n_tendons
        return np.clip(z[:n] * self.z_unit[:n], self.limits.lower, self.limits.upper)

    def states(self, z: Array) -> Array:
        """Return those in unknowns (n_states,)."""
        of = self.system.of
        return np.asarray((z * self.z_unit)[of.first : of.n_x])

    def solve(
        self,
        z: Array,
        eps: float = np.inf,
        slacks: bool = False,
        box: float = np.inf,
        near: Solution | None = None,
    ) -> Solution:
        """Return where ipopt comes to from unknowns z, tensions within a box around them [1].

        Its points are a little inside of bounds: of a `sharp` program the solution is corrected,
        with what is active there as equations. So is at once where what was active `near` leads.
        """
        n = self.system.of.n_tendons
        low, high, g_low, g_high = self.bounds(eps, slacks)
        low[:n] = np.maximum(low[:n], np.minimum(z[:n] - box, high[:n]))
        high[:n] = np.minimum(high[:n], np.maximum(z[:n] + box, low[:n]))
        bounds, p = (low, high, g_low, g_high), self.parameters(slacks)
        if near is not None and near.x.shape == z.shape and near.g.shape == g_low.shape:
            corrected = self._corrected(z, near, p, bounds)
            if corrected is not None:
                return corrected
        solution = solved(self.functions.solver, z, p, bounds)
        solution = replace(solution, met=solution.met and solution.finite)
        sharp = self.sharp and solution.met
        corrected = self._corrected(solution.x, solution, p, bounds) if sharp else None
        return solution if corrected is None else corrected

    def _corrected(self, z: Array, near: Solution, p: Array, bounds: Bounds) -> Solution | None:
        """Return the solution with what is active in one nearby as equations.

        None where there is none, or bounds or signs of multipliers are not kept.
        """
        low, high, g_low, g_high = bounds
        on_x, on_g = (
            _active(near.x, near.lam_x, low, high),
            _active(near.g, near.lam_g, g_low, g_high),
        )
        active = *on_x, *on_g
        solution = solved(self.functions.warm, z, p, active, (near.lam_x, near.lam_g))
        kept = _kept(solution.x, solution.lam_x, low, high) and _kept(
            solution.g, solution.lam_g, g_low, g_high
        )
        return solution if solution.met and solution.finite and kept else None

    def slack(self, z: Array) -> float:
        """Return by how much targets and wrenches are violated at unknowns: the sum of slacks."""
        return float(np.abs(z[self.structure.n_y :]).sum())

    def optimality(self, z: Array) -> Optimality:
        """Return how far unknowns in equilibrium are from the first-order conditions.

        The equations are eliminated; the multipliers of what holds leave least of the gradient.
        """
        at, f, n = self.structure, self.functions, self.system.of.n_tendons
        values_at = f.first(z, self.parameters(False))
        gradient, values = values_at[0].ravel(), values_at[1].ravel()
        J = csc_array((values_at[2].ravel(), *f.places), (f.n_g, z.size))
        low, high, g_low, g_high = self.bounds(np.inf, False)
        outer = np.append(np.arange(n), np.ravel(at.tangential))
        outer = outer[low[outer] < high[outer]]
        inner = np.append(np.arange(n + 1, self.system.of.n_x), np.arange(at.mode, at.n_y))
        square = np.append(
            np.arange(self.system.of.n_states), np.arange(f.first_mode, f.equations.n_g)
        )
        by_outer = -factorised(csc_array(J[square][:, inner])).solve(J[square][:, outer].toarray())

        def reduced(rows: Any) -> Array:
            return np.asarray(rows[:, outer] + rows[:, inner] @ by_outer)

        rest = np.setdiff1d(np.arange(f.n_g), square)
        rows, units = J.tocsr()[rest].toarray(), np.eye(z.size)
        values, g_low, g_high = values[rest], g_low[rest], g_high[rest]
        even = g_low == g_high
        bounded = np.append(outer, inner)
        parts = [
            (rows[even], -np.inf),
            (rows[~even & (values > g_high - _ACTIVE)], 0.0),
            (-rows[~even & (values < g_low + _ACTIVE)], 0.0),
            (units[bounded][z[bounded] > high[bounded] - _ACTIVE], 0.0),
            (-units[bounded][z[bounded] < low[bounded] + _ACTIVE], 0.0),
        ]
        active = np.vstack([block for block, _ in parts])
        least = np.concatenate([np.full(len(block), bound) for block, bound in parts])
        slope, lam = reduced(gradient[None])[0], np.zeros(len(active))
        M = reduced(active)
        if lam.size:
            with np.errstate(invalid="ignore"):
                lam = lsq_linear(M.T, -slope, (least, np.inf)).x
        off = float(np.abs(slope + M.T @ lam).max()) / (1 + float(np.abs(lam).max(initial=0.0)))
        ends = sum(len(block) for block, _ in parts[:3])
        pushed = lam[ends:] @ active[ends:]
        return Optimality(off, pushed[:n], float(pushed[at.n_y - 1]) if at.modes else 0.0)


def _active(values: Array, lam: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bounds that are equations where one is active, by its multiplier; none elsewhere."""
    at_low, at_high = (values - low < -lam) | (low == high), high - values < lam
    held, value = at_low | at_high, np.where(at_low, low, high)
    return np.where(held, value, -np.inf), np.where(held, value, np.inf)


def _kept(values: Array, lam: Array, low: Array, high: Array) -> bool:
    """Return whether values are within bounds, and multipliers push into them."""
    inside = (values > low - _ACTIVE) & (values < high + _ACTIVE)
    pushed = (lam > -_ACTIVE) | (values < low + _ACTIVE)
    pulled = (lam < _ACTIVE) | (values > high - _ACTIVE)
    return bool((inside & (pushed & pulled | (low == high))).all())
