"""How the tip of a loaded arm gives way along directions, with exact first and second derivatives.

The unknowns are z = (T, X), tensions and states at the segments' starts. With M the slopes of the
shooting constraints and of what holds the tendons, a force on the tip, which enters them by W,
moves z by M^-1 W and the tip by E of that. Along directions D the tip gives way by

    G = D^T E M^-1 W D          dG = -U^T dM V          V = M^-1 W D          U = M^-T E^T D

and a column of G times weights, with v that of V and u = U weights, has the second derivative

    2 (u^T dM) M^-1 (dM v) - u^T d2M v

With H(u) the Hessian of u times the constraints, u^T dM = H(u), and u^T d2M v is the change of H(u)
along v, as dM v is that of M. So all follows from the derivatives of the constraints that a program
has anyway, and one derivative of these along v. Where tendons stretch, M has their lengths over E A
on its diagonal besides.
Source: the second-order adjoint method, as in Hinze, Pinnau, Ulbrich, Ulbrich, "Optimization with
PDE Constraints" (2009), section 1.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from model.arm import Arm
from model.effects import Current
from model.forward import SCHEMES
from model.integrators.runge_kutta import RungeKutta
from model.loaded.loads import places
from model.loaded.segments import LoadSegments
from model.loaded.small_systems import DENSE
from model.mesh import graded
from model.scene import Scene
from model.stiffness import least_give
from model.unloaded.shooting import Shooting
from planner.program.derivatives import Derivatives
from planner.program.inner import Inner, through
from planner.program.segment_chain import SegmentChain
from planner.targets.base import Look


class LoadedGive:
    """The give of a loaded arm's tip along directions D (3, width), in the base frame.

    Unknowns are the tensions T, then the scaled starts X (n_x segments,) of a program.

    Attributes
    ----------
    values : casadi.Function
        (T, X, D) -> G (width^2,), column by column [m/N].
    first : casadi.Function
        (T, X, D) -> G, slopes (width^2, n_tendons + n_x segments).
    second : casadi.Function
        (T, X, D, weights (width^2,)) -> Hessian of weights . G.
    """

    def __init__(self, system: LoadSegments, n_x: int, look: Look) -> None:
        self.system, self.n, self.n_T = system, system.scale.size, system.arm.n_tendons
        m, width = len(system.segments), look.width
        constraints, place = self._constraints(look), self._place(n_x)
        T, X = ca.MX.sym("T", self.n_T), ca.MX.sym("X", n_x * m)
        D, weights = ca.MX.sym("D", 3, width), ca.MX.sym("weights", width**2)
        changed = _changes(constraints, system.arm, look.tendon_EA)
        z = place @ ca.vertcat(T, X)
        M = changed.slopes(z)
        V, U = ca.solve(M, self._force() @ D, DENSE), ca.solve(M.T, self._tip().T @ D, DENSE)
        changes = [changed.right(z, v) for v in ca.horzsplit(V)]
        G = ca.densify(ca.vec(D.T @ self._tip() @ V))
        slopes = ca.vertcat(*(-(U.T @ change) for change in changes))
        curved = ca.MX(place.shape[0], place.shape[0])
        along = ca.horzsplit(U @ ca.reshape(weights, width, width))
        for v, u, change in zip(ca.horzsplit(V), along, changes, strict=True):
            left, bent = changed.second(z, u, v)
            turned = left.T @ ca.solve(M, change, DENSE)
            curved += turned + turned.T - bent
        self.values = ca.Function("give", [T, X, D], [G])
        self.first = ca.Function("give_slopes", [T, X, D], [G, ca.densify(slopes @ place)])
        hessian = ca.densify(place.T @ curved @ place)
        self.second = ca.Function("give_curvature", [T, X, D, weights], [hessian])

    def _constraints(self, look: Look) -> Derivatives:
        """Return the derivatives of the shooting constraints and of what holds the tendons."""
        system, shooting = self.system, Shooting(self.system)
        chain, m = SegmentChain(system, ()), len(self.system.segments)
        z, none = ca.MX.sym("z", self.n_T + self.n * m), ca.MX.sym("none", 0)
        nodes = ca.MX.sym("nodes", self.n * len(chain.looks))
        at = ca.reshape(nodes, self.n, -1)
        T, scale = z[: self.n_T], ca.DM(system.scale)
        starts = [scale * x for x in ca.vertsplit(z[self.n_T :], self.n)]
        ends = [at[:, chain.end(i)] for i in range(m)]
        joined = shooting.joined(starts, ends, system.parameters(T))
        own = slice(self.n - system.equations.n_length, self.n)
        lengths = sum((y[own] - x[own] for x, y in zip(starts, ends, strict=True)), ca.MX(0))
        held = lengths - least_give(system.arm) * T if look.hold == "length" else T
        outer = ca.Function("constraints", [z, none, nodes], [0, ca.vertcat(joined, held)])
        functions = (chain.states, chain.first, chain.second)
        one = ca.MX.ones(self.n_T)
        return through(z, none, outer, [Inner.of_tensions(z, none, one, self.n_T, functions)])

    def _place(self, n_x: int) -> ca.DM:
        """Return the map from (T, starts of a program) to z: what else is a state there is 0."""
        m, rows = len(self.system.segments), self.n_T + self.n * len(self.system.segments)
        place = ca.DM(rows, self.n_T + n_x * m)
        place[: self.n_T, : self.n_T] = ca.DM.eye(self.n_T)
        kept = self._kept(n_x)
        for i in range(m):
            for k, row in enumerate(kept):
                place[self.n_T + i * self.n + row, self.n_T + i * n_x + k] = 1
        return place

    def _kept(self, n_x: int) -> list[int]:
        """Return which components of a state are states of the program too."""
        e = self.system.equations
        force = 7 + e.statics.size
        others = [i for i in range(self.n - e.n_length) if not force <= i < force + e.n_force]
        return others if n_x == len(others) else list(range(self.n - e.n_length))

    def _force(self) -> ca.DM:
        """Return W: a force on the tip is one that the force beyond it has to be."""
        W = ca.DM(self.n_T + self.n * len(self.system.segments), 3)
        first = self.system.equations.statics.size
        W[first : first + 3, :] = ca.DM.eye(3)
        return W

    def _tip(self) -> ca.DM:
        """Return E: the position at the first start [m]."""
        E = ca.DM(3, self.n_T + self.n * len(self.system.segments))
        first = self.n_T + 4
        E[:, first : first + 3] = self.system.scale[4] * ca.DM.eye(3)
        return E


@dataclass(frozen=True, eq=False)
class _Changes:
    """Functions of M.

    Attributes
    ----------
    slopes : casadi.Function
        z -> M.
    right : casadi.Function
        (z, v) -> dM v.
    second : casadi.Function
        (z, u, v) -> u^T dM with a row for each change of z, u^T d2M v.
    """

    slopes: ca.Function
    right: ca.Function
    second: ca.Function


def _changes(constraints: Derivatives, arm: Arm, tendon_EA: float | None) -> _Changes:
    """Return the functions of M = J - diag(l) / E A, with the slopes J of the constraints.

    The first columns of J are those against tensions, the last rows those of the lengths l of the
    tendons, less what they give, where these are held.
    """
    none, n, n_T = ca.MX(0, 1), constraints.slopes.size1_out(2), arm.n_tendons
    z, u, v = (ca.MX.sym(name, n) for name in "zuv")
    _, value, J = constraints.slopes(z, none)
    H = constraints.curvature(z, none, 0, u)
    M, right, left, bent = J, ca.jtimes(J, z, v), H, ca.jtimes(H, z, v)
    if tendon_EA is not None:
        T, held = ca.DM.eye(n)[:, :n_T], ca.DM.eye(n)[:, n - n_T :]
        lengths = held.T @ value + least_give(arm) * z[:n_T]
        slopes = (held.T @ J + least_give(arm) * T.T) / tendon_EA
        M -= held @ ca.diag(lengths / tendon_EA) @ T.T
        right -= held @ ca.diag(T.T @ v) @ slopes
        left -= T @ ca.diag(held.T @ u) @ slopes
        bent -= constraints.curvature(z, none, 0, held @ ((held.T @ u) * v[:n_T])) / tendon_EA
    return _Changes(
        ca.Function("slopes", [z], [M]),
        ca.Function("right", [z, v], [right]),
        ca.Function("second", [z, u, v], [left, bent]),
    )


@lru_cache(maxsize=64)
def loaded_give(
    arm: Arm, scene: Scene, scheme: str, refinement: int, stations: tuple[float, ...], look: Look
) -> LoadedGive:
    """Return how the tip gives way in a program on the mesh of planner.mechanics.shooting_system.

    A current that stands still does nothing but make the force beyond a section a state, so that a
    force on the tip is a change of states.
    """
    method = SCHEMES[scheme]
    assert isinstance(method, RungeKutta)
    mesh = graded(arm, refinement, (*stations, *places(arm, scene)))
    n_x = LoadSegments(arm, scene, mesh, method).equations.n_x
    still = () if scene.has(Current) else (Current((0.0, 0.0, 0.0)),)
    pushed = Scene(*scene.effects, *still)
    system = LoadSegments(arm, pushed, mesh, method, None, look.hold == "length")
    return LoadedGive(system, n_x, look)
