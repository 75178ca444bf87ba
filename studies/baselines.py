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
    """The paper's consistent statics in closed form, and eq. (1) integrated by solve_ivp."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.section = np.array([i for i, _ in arm.tendons])
        phi = np.array([angle for _, angle in arm.tendons])
        self.cos, self.sin = np.cos(phi), np.sin(phi)
        self.ends = np.array([section.at for section in arm.sections])

    def strains(self, s: float, T: Array, crossing: Array) -> tuple[float, float, float]:
        """Return xi, k, q of one cross-section, physics as in the README."""
        arm, at = self.arm, np.array([s])
        R = float(arm.radius.evaluate(at, arm.length)[0][0])
        E = arm.material.E
        EJ, EA = E * np.pi * R**4 / 4, E * np.pi * R**2
        y = np.array(
            [float(sec.offset.evaluate(at, sec.at)[0][0]) for sec in arm.sections]
        )[self.section]
        T = T * crossing
        pull = y * T
        c, d = pull @ self.cos, pull @ self.sin
        A = EJ + pull * y @ self.sin**2
        B = EJ + pull * y @ self.cos**2
        C = -(pull * y) @ (self.sin * self.cos)
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
                    self._rate, (start, end), x, method, args=(T, crossing), rtol=rtol, atol=rtol
                ).y[:, -1]
                start = end
        return np.asarray(x[9:])

    def _rate(self, s: float, x: Array, T: Array, crossing: Array) -> Array:
        xi, k, q = self.strains(s, T, crossing)
        t, n, b = x[:3], x[3:6], x[6:9]
        return (1 + q) * np.concatenate([k * n - xi * b, -k * t, xi * t, t])

    def plan_tip(self, point: Array, upper: float, start: Array) -> tuple[Array, float, bool]:
        """Return (tensions, distance to the point [m], success) by SLSQP, finite differences."""
        L = self.arm.length
        found: Any = minimize(
            lambda T: T @ T,
            start,
            method="SLSQP",
            bounds=[(0.0, upper)] * len(start),
            constraints={"type": "eq", "fun": lambda T: (self.tip(T) - point) / L},
            options={"maxiter": 200},
        )
        gap = float(np.linalg.norm(self.tip(found.x) - point))
        return found.x, gap, bool(found.success and gap < 1e-6 * L)
