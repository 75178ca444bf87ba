"""Loaded rods in space, by shooting from the tip with NumPy and SciPy only.

Nothing here imports the project. The state is the pose and the force and moment of the loads
beyond, all in the base frame; strains follow from the balance of a cross-section with the paper's
tangent, or from the least energy of exact tendons on a linear or rubber body, whose gradient is by
complex steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from tests.oracles import Array, Rod


def zeros() -> Array:
    return np.zeros(3)


def cross(a: Array, b: Array) -> Array:
    """Return the cross product, faster than NumPy's for three numbers."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads: at the tip (dead or follower), at points, per length, and the drag of a current."""

    force: Array = field(default_factory=zeros)
    moment: Array = field(default_factory=zeros)
    follower: bool = False
    points: tuple[tuple[float, Array], ...] = ()
    specific_weight: Array = field(default_factory=zeros)  # per volume of the body
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
        """Return S[T], S[T d] and S[T (1 - d d^T)] of each section."""
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
        f = np.pi * r**2 * self.loads.specific_weight
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
        """Return the rotation (3,) of the base from its clamp."""
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


_STEP, _DIFFERENCE, _NEWTON = 1e-30, 1e-6, 30


@dataclass(frozen=True, eq=False)
class EnergyRod(LoadedRod):
    """The same with tendons of energy T |c|, on a linear or neo-Hookean body."""

    rubber: bool = False

    @cached_property
    def _last(self) -> list[Array]:
        """The last strains, from which the next search begins."""
        return [np.array([0.0, 0.0, 0.0, 1.0])]

    def energy(self, v: Any, s: float, active: int) -> Any:
        """Return the energy per unit length of body and tendons, less nothing, at strains v."""
        rod, kappa, stretch = self.rod, v[:3], v[3]
        r = float(rod.radius(s))
        EA, EJ = rod.E * np.pi * r**2, rod.E * np.pi * r**4 / 4
        GI, bend = EJ / (1 + rod.nu), kappa[1] ** 2 + kappa[2] ** 2
        if self.rubber:
            W = EA / 6 * (stretch**2 + 2 / stretch - 3)
            W += EJ * (1 + 2 / stretch**3) / (6 * stretch) * bend
            W += GI / (2 * stretch) * kappa[0] ** 2
        else:
            W = (EA * (stretch - 1) ** 2 + EJ * bend + GI * kappa[0] ** 2) / 2
        width = 1 / np.sqrt(stretch) if self.rubber else 1.0
        tension = iter(self.T)
        for section in rod.sections[:active]:
            y, slope = float(section.offset(s)), float(section.slope(s))
            for phi in section.angles:
                cos, sin = np.cos(phi), np.sin(phi)
                c = [
                    stretch + width * y * (kappa[1] * sin - kappa[2] * cos),
                    width * (slope * cos - y * kappa[0] * sin),
                    width * (slope * sin + y * kappa[0] * cos),
                ]
                W += next(tension) * np.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)
        return W

    def _gradient(self, v: Array, s: float, active: int) -> Array:
        """Return the wrench of a cross-section, by complex steps in all strains at once."""
        shifted = np.asarray(v, dtype=complex)[:, None] + 1j * _STEP * np.eye(4)
        return np.asarray(np.imag(self.energy(shifted, s, active)) / _STEP)

    def strains(self, s: float, R: Array, F: Array, M: Array, active: int) -> tuple[Array, Array]:
        """Return omega and nu of the cross-section that balances the local wrench."""
        wrench, free = np.append(R.T @ M, (R.T @ F)[0]), 3 + self.extension
        v, scale = self._last[0].copy(), np.append(np.full(3, 1 / self.rod.length), 1.0)
        for _ in range(_NEWTON):
            off = (self._gradient(v, s, active) - wrench)[:free]
            h = _DIFFERENCE * scale
            sides = [
                [self._gradient(v + sign * h[k] * np.eye(4)[k], s, active) for sign in (1, -1)]
                for k in range(free)
            ]
            H = np.array([(up - down)[:free] / (2 * h[k]) for k, (up, down) in enumerate(sides)])
            step = -np.linalg.solve(H.T, off)
            v[:free] += step
            if np.all(np.abs(step) < 1e-9 * (scale + np.abs(v))[:free]):
                break
        else:
            raise RuntimeError("a cross-section does not settle")
        self._last[0] = v
        return v[:3] / v[3], np.array([v[3], 0.0, 0.0])
