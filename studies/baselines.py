"""What a user writes without this project: SciPy on the closed-form strains, for comparison.

NumPy and SciPy only; nothing of `model` or `planner` but the numbers of the arm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from model import Arm

Array = NDArray[np.float64]


class ScipyArm:
    """The paper's consistent statics in closed form, and eq. (1) integrated by solve_ivp.

    For conical arms with linear offsets, whose numbers are worked out beforehand.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
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
                x = solve_ivp(
                    self._rate, (start, end), x, method, args=(T * crossing,), rtol=rtol, atol=rtol
                ).y[:, -1]
                start = end
        return np.asarray(x[9:])

    def _rate(self, s: float, x: Array, T: Array) -> Array:
        xi, k, q = self.strains(s, T)
        t, n, b = x[:3], x[3:6], x[6:9]
        rate = np.empty(12)
        rate[:3], rate[3:6], rate[6:9], rate[9:] = k * n - xi * b, -k * t, xi * t, t
        return (1 + q) * rate

    def plan_tip(self, point: Array, upper: float, start: Array) -> tuple[Array, float, bool]:
        """Return (tensions, distance to the point [m], success) by SLSQP, finite differences."""
        L = self.arm.length
        found: Any = minimize(
            lambda T: T @ T,
            start,
            method="SLSQP",
            bounds=[(0.0, upper)] * len(start),
            constraints={"type": "eq", "fun": lambda T: (self.tip(T) - point) / L},
            options={"maxiter": 200, "eps": 1e-6},
        )
        gap = float(np.linalg.norm(self.tip(found.x) - point))
        return found.x, gap, bool(found.success and gap < 1e-6 * L)
