"""A loaded arm as a user writes it without this project: SciPy, by shooting and by collocation.

NumPy and SciPy only; nothing of `model` or `planner` but the numbers of the arm. The paper's
consistent statics with extension, weight in a fluid and a dead force at the tip. Such loads are
known along the arm before its shape is: F(s) is a polynomial; M' = -u' x F, M = 0 at the tip.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from model import Arm

Array = NDArray[np.float64]


class ScipyLoadedArm:
    """A conical arm with linear offsets under tensions, a tip force [N] and gravity [m/s2].

    A state is frame (9, by rows), moment of the loads beyond (3) and position (3), base frame. The
    loads are applied in `steps`. `rhs` counts the right-hand sides that were evaluated.
    """

    def __init__(
        self, arm: Arm, force: Array, gravity: Array, fluid: float = 0.0, steps: int = 1
    ) -> None:
        self.arm, self.force, self.steps, self.rhs = arm, force, steps, 0
        self.spread = np.pi * (arm.material.density - fluid) * gravity
        self.base = np.array(arm.base_frame)
        at = np.array([section.at for section in arm.sections])
        self.of = np.array([i for i, _ in arm.tendons])
        phi = np.array([angle for _, angle in arm.tendons])
        self.cos, self.sin, self.ends = np.cos(phi), np.sin(phi), at[self.of]
        offsets = np.array(
            [sec.offset.evaluate(np.array([0, sec.at]), sec.at)[0] for sec in arm.sections]
        )
        self.y0, self.slope = offsets[self.of, 0], (np.diff(offsets)[:, 0] / at)[self.of]
        self.R0, self.R1 = arm.radius.evaluate(np.array([0, arm.length]), arm.length)[0].tolist()
        self.breaks = np.array(sorted({0.0, arm.length, *at.tolist()}))

    def radius(self, s: Any) -> tuple[Array, float]:
        """Return the radius at arc lengths s [m], and its slope."""
        slope = (self.R1 - self.R0) / self.arm.length
        return self.R0 + slope * np.asarray(s), slope

    def rate(self, s: Any, x: Array, T: Array, share: float) -> Array:
        """Return the derivative of states (15, N) at arc lengths s (N,), tensions T crossing."""
        self.rhs += np.size(s)
        E, G = self.arm.material.E, self.arm.material.G
        r, c = self.radius(s)
        frame, M = x[:9].reshape(3, 3, -1), x[9:12]
        volume = (self.R1**3 - r**3) / (3 * c)
        F = share * (self.force[:, None] + self.spread[:, None] * volume)
        m, F_t = np.einsum("ijn,in->jn", frame, M), np.einsum("in,in->n", frame[:, 0], F)
        y = self.y0[:, None] + self.slope[:, None] * np.asarray(s)
        cos, sin = self.cos[:, None], self.sin[:, None]
        pull, EJ = y * T[:, None], E * np.pi * r**4 / 4
        lever, (a, b) = pull * y, ((pull * cos).sum(0), (pull * sin).sum(0))
        A, B = EJ + (lever * sin**2).sum(0), EJ + (lever * cos**2).sum(0)
        C, m_n, m_b = -(lever * sin * cos).sum(0), m[1] - b, m[2] + a
        det = A * B - C * C
        tau = m[0] / (G * np.pi * r**4 / 2 + lever.sum(0))
        xi, k = (B * m_n - C * m_b) / det, (A * m_b - C * m_n) / det
        grow = 1 + (k * a - xi * b - T.sum() + F_t) / (E * np.pi * r**2)
        t, n, b_ = frame[:, 0], frame[:, 1], frame[:, 2]
        turned = np.stack([k * n - xi * b_, tau * b_ - k * t, xi * t - tau * n], axis=1)
        u = grow * t
        moment = np.stack(
            [F[1] * u[2] - F[2] * u[1], F[2] * u[0] - F[0] * u[2], F[0] * u[1] - F[1] * u[0]]
        )
        return np.concatenate([(grow * turned).reshape(9, -1), moment, u])

    def _crossing(self, T: Array, end: float) -> Array:
        return T * (self.ends >= end)

    def _sweep(self, tip: Array, T: Array, share: float, rtol: float, method: str) -> Array:
        """Return the state (15,) at the base for a frame of the tip, which is at the origin."""
        x = np.concatenate([tip.ravel(), np.zeros(6)])

        def rate(s: float, x: Array, crossing: Array) -> Array:
            return self.rate(s, x[:, None], crossing, share)[:, 0]

        for high, low in pairwise(self.breaks[::-1]):
            args = (self._crossing(T, high),)
            run: Any = solve_ivp(rate, (high, low), x, method, args=args, rtol=rtol, atol=rtol)
            x = run.y[:, -1]
        return np.asarray(x)

    def shoot(self, T: Array, rtol: float, method: str = "DOP853") -> Array:
        """Return the tip: the frame of the tip is what makes the base end in its clamp."""
        free = self._sweep(np.eye(3), T, 0.0, rtol, method)[:9].reshape(3, 3)
        tip = self.base @ free.T
        for share in np.linspace(0, 1, self.steps + 1)[1:]:

            def off(w: Array, tip: Array = tip, share: float = share) -> Array:
                turned = Rotation.from_rotvec(w).as_matrix() @ tip
                found = self._sweep(turned, T, share, rtol, method)[:9].reshape(3, 3)
                return Rotation.from_matrix(found @ self.base.T).as_rotvec()

            found: Any = root(off, np.zeros(3), tol=rtol, options={"eps": rtol**0.5})
            tip = Rotation.from_rotvec(found.x).as_matrix() @ tip
        end = self._sweep(tip, T, 1.0, rtol, method)
        return np.asarray(np.array(self.arm.base_position) - end[12:])

    def collocate(self, T: Array, tol: float, nodes: int = 8) -> Array:
        """Return the tip by solve_bvp, the anchorage segments side by side on [0, 1]."""
        low, high = self.breaks[:-1], self.breaks[1:]
        crossing, n = [self._crossing(T, end) for end in high], len(low)
        unit = np.concatenate([np.ones(9), np.full(3, 1e-3), np.full(3, self.arm.length)])[:, None]
        start = np.concatenate([self.base.ravel(), np.zeros(6)])
        start[12:] = self.arm.base_position

        def rate(z: Array, x: Array, share: float) -> Array:
            parts = [
                (b - a) / unit * self.rate(a + (b - a) * z, unit * part, pulls, share)
                for a, b, part, pulls in zip(low, high, np.split(x, n), crossing, strict=True)
            ]
            return np.concatenate(parts)

        def ends(left: Array, right: Array) -> Array:
            a, b = left.reshape(n, 15), right.reshape(n, 15)
            clamp = np.delete(a[0] - start / unit[:, 0], [9, 10, 11])
            return np.concatenate([clamp, (b[:-1] - a[1:]).ravel(), b[-1, 9:12]])

        z = np.linspace(0, 1, nodes)
        guess = self._unloaded(T, z, unit[:, 0])
        for share in np.linspace(0, 1, self.steps + 1)[1:]:
            found: Any = solve_bvp(
                lambda z, x, share=share: rate(z, x, share), ends, z, guess, tol=tol, max_nodes=4000
            )
            z, guess = found.x, found.y
        return np.asarray(guess[-3:, -1] * unit[-3:, 0])

    def _unloaded(self, T: Array, z: Array, unit: Array) -> Array:
        """Return the states (15 segments, len(z)) of the arm without its loads, in units."""
        x, rows = np.concatenate([self.base.ravel(), np.zeros(3), self.arm.base_position]), []
        for a, b in pairwise(self.breaks):
            crossing = self._crossing(T, b)

            def rate(s: float, x: Array, crossing: Array = crossing) -> Array:
                return self.rate(s, x[:, None], crossing, 0.0)[:, 0]

            run: Any = solve_ivp(rate, (a, b), x, "DOP853", t_eval=a + (b - a) * z, rtol=1e-4)
            rows.append(run.y / unit[:, None])
            x = run.y[:, -1]
        return np.concatenate(rows)
