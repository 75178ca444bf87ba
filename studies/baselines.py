"""What a user writes without this project: SciPy on the closed-form strains, for comparison.

NumPy and SciPy only; nothing of `model` or `planner` but the numbers of the arm.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from model import Arm

Array = NDArray[np.float64]


class ScipyArm:
    """The paper's consistent statics in closed form, and eq. (1) integrated by solve_ivp.

    For conical arms with linear offsets, whose numbers are worked out beforehand. `rhs` counts the
    right-hand sides that were evaluated.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self.rhs = arm, 0
        self.section = np.array([i for i, _ in arm.tendons])
        phi = np.array([angle for _, angle in arm.tendons])
        self.cos, self.sin = np.cos(phi), np.sin(phi)
        self.ends = np.array([section.at for section in arm.sections])
        ends = [path.evaluate(np.array([0.0, at]), at)[0] for path, at in self._paths()]
        (R0, R1), offsets = ends[0], np.array(ends[1:])[self.section]
        self.R0, self.R_slope = float(R0), float((R1 - R0) / arm.length)
        self.y0 = offsets[:, 0]
        self.y_slope = (offsets[:, 1] - offsets[:, 0]) / self.ends[self.section]

    def _paths(self) -> list[tuple[Any, float]]:
        sections = self.arm.sections
        return [(self.arm.radius, self.arm.length), *((sec.offset, sec.at) for sec in sections)]

    def strains(self, s: float, T: Array) -> tuple[float, float, float]:
        """Return xi, k, q of the cross-section at s under the tensions that cross it."""
        area = np.pi * (self.R0 + self.R_slope * s) ** 2
        E = self.arm.material.E
        EJ, EA = E * area**2 / (4 * np.pi), E * area
        y = self.y0 + self.y_slope * s
        pull = y * T
        c, d = pull @ self.cos, pull @ self.sin
        lever = pull * y
        A = EJ + lever @ self.sin**2
        B = EJ + lever @ self.cos**2
        C = -lever @ (self.sin * self.cos)
        det = A * B - C * C
        xi, k = (-B * d - C * c) / det, (A * c + C * d) / det
        return xi, k, (k * c - xi * d - T.sum()) / EA

    def tip(self, T: Array, method: str = "DOP853", rtol: float = 1e-8) -> Array:
        """Return the tip position, integrating base to tip segment by segment."""
        frame = np.array(self.arm.base_frame)
        x = np.concatenate([frame.T.ravel(), self.arm.base_position])
        start = 0.0
        for end in [*self.ends[::-1], self.arm.length]:
            if end > start:
                crossing = (self.ends[self.section] >= end).astype(float)
                run = solve_ivp(
                    self._rate, (start, end), x, method, args=(T * crossing,), rtol=rtol, atol=rtol
                )
                self.rhs += run.nfev
                x, start = run.y[:, -1], end
        return np.asarray(x[9:])

    def _rate(self, s: float, x: Array, T: Array) -> Array:
        xi, k, q = self.strains(s, T)
        t, n, b = x[:3], x[3:6], x[6:9]
        rate = np.empty(12)
        rate[:3], rate[3:6], rate[6:9], rate[9:] = k * n - xi * b, -k * t, xi * t, t
        return (1 + q) * rate

    def least_stretch(self, T: Array) -> float:
        """Return the least 1 + q at both ends of each segment, where it is least as arms taper."""
        found, start = [], 0.0
        for end in [*self.ends[::-1], self.arm.length]:
            crossing = T * (self.ends[self.section] >= end)
            found += [1 + self.strains(s, crossing)[2] for s in (start, end)]
            start = end
        return min(found)

    def tip_jacobian(self, T: Array, rtol: float, steps: Array, central: bool) -> Array:
        """Return how the tip moves with each tension (3, n) [m/N], by differences of `steps`."""
        here = None if central else self.tip(T, rtol=rtol)
        columns = []
        for change, step in zip(np.diag(steps), steps, strict=True):
            ahead = self.tip(T + change, rtol=rtol)
            if here is None:
                columns.append((ahead - self.tip(T - change, rtol=rtol)) / (2 * step))
            else:
                columns.append((ahead - here) / step)
        return np.array(columns).T

    def plan_tip(
        self,
        point: Array,
        upper: float,
        start: Array,
        ftol: float = 1e-6,
        rtol: float = 1e-8,
        within: float = 1e-6,
    ) -> tuple[Array, float, bool]:
        """Return (tensions, distance to the point [m], success) by SLSQP, finite differences.

        Success is SLSQP's word, a tip within that share of L, and an arm that is not crushed.
        """
        L = self.arm.length
        found: Any = minimize(
            lambda T: T @ T,
            start,
            method="SLSQP",
            bounds=[(0.0, upper)] * len(start),
            constraints={"type": "eq", "fun": lambda T: (self.tip(T, rtol=rtol) - point) / L},
            options={"maxiter": 200, "eps": 1e-6, "ftol": ftol},
        )
        gap = float(np.linalg.norm(self.tip(found.x) - point))
        solved = found.success and gap < within * L and self.least_stretch(found.x) > 0
        return found.x, gap, bool(solved)

    def plan_tip_from(
        self, point: Array, upper: float, starts: Iterable[Array]
    ) -> tuple[Array, bool]:
        """Return (tensions, success) of the first start that leads to the point."""
        for start in starts:
            T, _, solved = self.plan_tip(point, upper, start)
            if solved:
                break
        return T, solved
