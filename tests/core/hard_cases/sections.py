"""A cross-section with exact tendons by SciPy: the least energy, followed from no tension.

Nothing here imports the project. Strains (a, b, lambda) are kappa_n, kappa_b over the square root
of lambda for a neo-Hookean body, kappa_n, kappa_b for a linear one; see section 4 of the physics:
energy per unit reference length of the body plus the sum of T |c|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from tests.oracles import Array


@dataclass(frozen=True, eq=False)
class CrossSection:
    """E A, E J; tension, offset, slope and angle of each tendon; whether neo-Hookean."""

    EA: float
    EJ: float
    T: Array
    y: Array
    slope: Array
    angle: Array
    rubber: bool

    def energy(self, x: Array, share: float) -> float:
        """The energy over E A, of curvatures times the radius and lambda, at a share of T."""
        k, stretch = x[:2] / self.radius, x[2]
        if stretch <= 0:
            return np.inf
        bend = self.EJ * (k @ k) / 2
        if self.rubber:
            body = self.EA / 6 * (stretch**2 + 2 / stretch - 3) + bend * (1 + 2 / stretch**3) / 3
        else:
            body = self.EA / 2 * (stretch - 1) ** 2 + bend
        along, side = self._tangents(x)
        return float((body + share * self.T @ np.hypot(along, side)) / self.EA)

    @property
    def radius(self) -> float:
        return float(2 * np.sqrt(self.EJ / self.EA))

    def _tangents(self, x: Array) -> tuple[Array, Array]:
        k, shrink = x[:2] / self.radius, x[2] ** -0.5 if self.rubber else 1.0
        inward = self.y * (k[1] * np.cos(self.angle) - k[0] * np.sin(self.angle))
        return x[2] - inward, self.slope * shrink

    def gradient(self, x: Array, share: float) -> Array:
        """The derivative of the energy."""
        k, stretch = x[:2] / self.radius, x[2]
        if self.rubber:
            bend, more = (
                self.EJ * k * (1 + 2 / stretch**3) / 3,
                self.EA / 3 * (stretch - stretch**-2),
            )
            more -= self.EJ * (k @ k) / stretch**4
        else:
            bend, more = self.EJ * k, self.EA * (stretch - 1)
        along, side = self._tangents(x)
        length = np.hypot(along, side)
        pull = share * self.T * along / length
        lever = np.array(
            [pull @ (self.y * np.sin(self.angle)), -pull @ (self.y * np.cos(self.angle))]
        )
        more += pull.sum()
        if self.rubber:
            more -= share * (self.T * side**2 / length).sum() / (2 * stretch)
        return np.array([*(bend + lever) / self.radius, more]) / self.EA

    def hessian(self, x: Array, share: float) -> Array:
        """Return central differences, which are accurate enough for Newton's steps."""
        columns = []
        for i in range(3):
            h = 1e-7 * np.eye(3)[i]
            columns.append((self.gradient(x + h, share) - self.gradient(x - h, share)) / 2e-7)
        H = np.array(columns)
        return (H + H.T) / 2

    def strains(self, steps: int = 40) -> Array:
        """Return (xi, k, q) under the full pull, which grows by steps, the first ones small."""
        x = np.array([0.0, 0.0, 1.0])
        for share in np.append(np.geomspace(1e-4, 1, steps), 1.0):
            args = {"jac": self.gradient, "hess": self.hessian, "args": (share,)}
            x = minimize(self.energy, x, method="trust-exact", tol=1e-14, **args).x
        for _ in range(8):
            x = x - np.linalg.solve(self.hessian(x, 1.0), self.gradient(x, 1.0))
        scale = x[2] ** -0.5 if self.rubber else 1 / x[2]
        return np.array([*(x[:2] / self.radius * scale), x[2] - 1])
