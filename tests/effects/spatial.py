"""A loaded rod in space with the paper's tangent, by shooting from the tip: NumPy and SciPy only.

Nothing here imports the project. The state is the pose and the force and moment of the loads
beyond, all in the base frame; the strains follow from the balance of a cross-section.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from tests.oracles import Rod

Array = NDArray[np.float64]


def zeros() -> Array:
    return np.zeros(3)


def cross(a: Array, b: Array) -> Array:
    """The cross product, without what makes NumPy's slow for three numbers."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@dataclass(frozen=True, eq=False)
class Loads:
    """What pulls: at the tip (dead or following it), at points, spread, and a stream's drag."""

    force: Array = field(default_factory=zeros)
    moment: Array = field(default_factory=zeros)
    follower: bool = False
    points: tuple[tuple[float, Array], ...] = ()
    heaviness: Array = field(default_factory=zeros)  # per volume of the body
    velocity: Array = field(default_factory=zeros)
    drag: float = 1100.0  # density times coefficient


@dataclass(frozen=True, eq=False)
class LoadedRod:
    """A rod under tensions T and loads, with or without extension and shear."""

    rod: Rod
    T: Array
    loads: Loads
    extension: bool = True
    k_s: float | None = None

    @cached_property
    def _pulls(self) -> list[tuple[float, Array, Array]]:
        """Of each section, S[T], S[T d] and S[T (1 - d d^T)]."""
        rows, tension = [], iter(self.T)
        for section in self.rod.sections:
            T = np.array([next(tension) for _ in section.angles])
            d = np.array([[0, np.cos(phi), np.sin(phi)] for phi in section.angles])
            rows.append((T.sum(), T @ d, T.sum() * np.eye(3) - (T * d.T) @ d))
        return rows

    def strains(self, s: float, R: Array, F: Array, M: Array, active: int) -> tuple[Array, Array]:
        """Return omega, and nu per unit reference length, in local components."""
        rod, local = self.rod, R.T @ F
        r = float(rod.radius(s))
        EA, EJ = rod.E * np.pi * r**2, rod.E * np.pi * r**4 / 4
        D, m = np.diag([EJ / (1 + rod.nu), EJ, EJ]), R.T @ M
        offsets = [float(section.offset(s)) for section in rod.sections[:active]]
        for y, (_, c, spread) in zip(offsets, self._pulls, strict=False):
            D += y**2 * spread
            m += y * np.array([0, -c[2], c[1]])
        omega = np.linalg.solve(D, m)
        pulled = zeros()
        for y, section, (total, c, _) in zip(offsets, rod.sections, self._pulls, strict=False):
            pulled += y * cross(omega, c)
            pulled[0] += total
            if self.k_s is not None:
                pulled += float(section.slope(s)) * c
        nu = np.array([1.0, 0, 0])
        if self.extension:
            nu[0] += (local[0] - pulled[0]) / EA
        if self.k_s is not None:
            nu[1:] += (local - pulled)[1:] * 2 * (1 + rod.nu) / (self.k_s * EA)
        return omega, nu

    def _rate(self, s: float, state: Array, active: int, share: float) -> Array:
        R, F, M = state[3:12].reshape(3, 3), state[12:15], state[15:]
        omega, nu = self.strains(s, R, F, M, active)
        kappa = nu[0] * omega
        spin = np.array(
            [[0, -kappa[2], kappa[1]], [kappa[2], 0, -kappa[0]], [-kappa[1], kappa[0], 0]]
        )
        v, t, r = self.loads.velocity, R[:, 0], float(self.rod.radius(s))
        across = v - t * (t @ v)
        f = np.pi * r**2 * self.loads.heaviness
        f = f + self.loads.drag * r * nu[0] * np.linalg.norm(across) * across
        u_rate = R @ nu
        return np.concatenate([u_rate, (R @ spin).ravel(), -share * f, -cross(u_rate, F)])

    def run(
        self, tip: Array, share: float = 1.0, stops: tuple[float, ...] = ()
    ) -> dict[float, Array]:
        """Return states at the breaks and stops, for a frame of the tip, which is at the origin."""
        loads = self.loads
        turn = tip if loads.follower else np.eye(3)
        F, M = share * turn @ loads.force, share * turn @ loads.moment
        state = np.concatenate([zeros(), tip.ravel(), F, M])
        at = dict(loads.points)
        places = np.unique([*self.rod.breaks(), *at, *stops])[::-1]
        found = {}
        for high, low in pairwise(places):
            state = state.copy()
            state[12:15] += share * at.get(float(high), zeros())
            found[float(high)] = state
            args = (self.rod.active(high), share)
            run = solve_ivp(
                self._rate, (high, low), state, "DOP853", args=args, rtol=1e-9, atol=1e-12
            )
            state = run.y[:, -1]
        found[0.0] = state
        return found

    def gap(self, tip: Array, share: float = 1.0) -> Array:
        """The rotation (3,) by which the base is off its clamp."""
        base = self.run(tip, share)[0.0][3:12].reshape(3, 3)
        return np.asarray(Rotation.from_matrix(base @ self.rod.frame.T).as_rotvec())

    def settle(self, shares: int = 2) -> Array:
        """The frame of the tip, followed from that without loads."""
        free = self.run(np.eye(3), 0.0)[0.0][3:12].reshape(3, 3)
        tip = self.rod.frame @ free.T
        for share in np.linspace(0, 1, shares + 1)[1:]:

            def off(w: Array, tip: Array = tip, share: float = share) -> Array:
                return self.gap(Rotation.from_rotvec(w).as_matrix() @ tip, share)

            found = root(off, zeros(), tol=1e-12)
            assert np.linalg.norm(found.fun) < 1e-9
            tip = Rotation.from_rotvec(found.x).as_matrix() @ tip
        return tip

    def poses(self, s: tuple[float, ...], shares: int = 2) -> tuple[Array, Array]:
        """Positions (N, 3) and frames (N, 3, 3) of the settled rod."""
        found = self.run(self.settle(shares), stops=s)
        rows = np.array([found[x] for x in s])
        base = found[0.0][:3]
        return rows[:, :3] - base + self.rod.position, rows[:, 3:12].reshape(-1, 3, 3)
