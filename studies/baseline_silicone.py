"""A silicone arm as a user writes it without this project: SciPy, by shooting and by collocation.

NumPy and SciPy only; nothing of `model` or `planner` but the numbers of the arm. Exact tendons on a
neo-Hookean body, its weight in a fluid and a dead force at the tip. Each cross-section settles by
Newton's method: with the stretch l, b = l^(-1/2) kappa and c a tendon's tangent, where

    EA (l^2 + 2/l) / 6 + EJ (1 + 2/l^3) b_bend^2 / 6 + GI b_t^2 / 2
        + sum T |c| - l^(1/2) m . b - F_t l

is least, m and F_t the moment and the pull of the loads beyond.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.baseline_loads import ScipyLoadedArm

Array = NDArray[np.float64]
_STEPS, _SETTLED, _FARTHEST = 60, 1e-12, 0.3


class ScipySiliconeArm(ScipyLoadedArm):
    """See ScipyLoadedArm; a conical arm of silicone."""

    def rate(self, s: Any, x: Array, T: Array, share: float) -> Array:
        """See ScipyLoadedArm.rate."""
        self.rhs += np.size(s)
        r, slope = self.radius(s)
        frame, M = x[:9].reshape(3, 3, -1), x[9:12]
        volume = (self.R1**3 - r**3) / (3 * slope)
        F = share * (self.force[:, None] + self.spread[:, None] * volume)
        m, F_t = np.einsum("ijn,in->jn", frame, M), np.einsum("in,in->n", frame[:, 0], F)
        z = self._settled(np.atleast_1d(s), np.broadcast_to(r, F_t.shape), m, F_t, T)
        kappa, t = z[:, :3].T * np.sqrt(z[:, 3]), frame[:, 0]
        n, b = frame[:, 1], frame[:, 2]
        turned = np.stack(
            [kappa[2] * n - kappa[1] * b, kappa[0] * b - kappa[2] * t, kappa[1] * t - kappa[0] * n],
            axis=1,
        )
        u = z[:, 3] * t
        return np.concatenate([turned.reshape(9, -1), np.cross(F.T, u.T).T, u])

    def _settled(self, s: Array, r: Array, m: Array, F_t: Array, T: Array) -> Array:
        """Return b (3,) and l of each cross-section (N, 4)."""
        E, G = self.arm.material.E, self.arm.material.G
        EA, EJ, GI = E * np.pi * r**2, E * np.pi * r**4 / 4, G * np.pi * r**4 / 2
        z = np.zeros((len(r), 4))
        z[:, 3] = 1 / np.sqrt(1 + 2 * T.sum() / EA)
        unit = np.array([1.0, 1.0, 1.0, 0.0]) * r[:, None] + np.array([0.0, 0.0, 0.0, 1.0])
        for _ in range(_STEPS):
            stretch, bend = z[:, 3], z[:, 1] ** 2 + z[:, 2] ** 2
            root, soft = np.sqrt(stretch), EJ * (1 + 2 / stretch**3) / 3
            g, H = self._tendons(z, s, T)
            g[:, :3] += np.stack([GI, soft, soft], 1) * z[:, :3] - root[:, None] * m.T
            work = (m.T * z[:, :3]).sum(1)
            g[:, 3] += EA * (stretch - stretch**-2) / 3 - EJ * bend / stretch**4
            g[:, 3] -= work / (2 * root) + F_t
            H[:, [0, 1, 2], [0, 1, 2]] += np.stack([GI, soft, soft], 1)
            across = -2 * EJ[:, None] / stretch[:, None] ** 4 * z[:, :3] * [0, 1, 1]
            across -= m.T / (2 * root[:, None])
            H[:, :3, 3] += across
            H[:, 3, :3] += across
            H[:, 3, 3] += EA * (1 + 2 / stretch**3) / 3 + 4 * EJ * bend / stretch**5
            H[:, 3, 3] += work / (4 * stretch * root)
            step = -np.linalg.solve(H, g[:, :, None])[:, :, 0]
            size = np.abs(step * unit).max(1)
            z += step * np.minimum(1.0, _FARTHEST * stretch / np.maximum(size, 1e-300))[:, None]
            if size.max() < _SETTLED:
                return z
        raise RuntimeError("a cross-section does not settle")

    def _tendons(self, z: Array, s: Array, T: Array) -> tuple[Array, Array]:
        """Return gradient (N, 4) and Hessian (N, 4, 4) of sum T |c| at z (N, 4)."""
        y, rate = self.y0 + self.slope * s[:, None], np.broadcast_to(self.slope, (len(s), T.size))
        one, none, stretch = np.ones_like(y), np.zeros_like(y), z[:, 3, None]
        along = np.stack([none, y * self.sin, -y * self.cos, one], 2)
        a = (along * z[:, None, :]).sum(2)
        length = np.sqrt(a**2 + rate**2 / stretch + (y * z[:, :1]) ** 2)
        p = a[:, :, None] * along
        p[:, :, 0] += y**2 * z[:, :1]
        p[:, :, 3] -= rate**2 / (2 * stretch**2)
        q = along[:, :, :, None] * along[:, :, None, :]
        q[:, :, 0, 0] += y**2
        q[:, :, 3, 3] += rate**2 / stretch**3
        unit = p / length[:, :, None]
        bent = (q - unit[:, :, :, None] * unit[:, :, None, :]) / length[:, :, None, None]
        return np.einsum("i,nij->nj", T, unit), np.einsum("i,nijk->njk", T, bent)
