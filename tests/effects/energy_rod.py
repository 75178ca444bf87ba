"""A loaded rod whose cross-sections settle by an energy, of NumPy and SciPy only.

Exact tendons on a linear or rubber body; nothing here imports the project. The gradient of the
energy is by complex steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.effects.spatial import LoadedRod

Array = NDArray[np.float64]
_STEP, _DIFFERENCE, _NEWTON = 1e-30, 1e-6, 30


@dataclass(frozen=True, eq=False)
class EnergyRod(LoadedRod):
    """The same with tendons of energy T |c|, on a linear or neo-Hookean body."""

    rubber: bool = False

    @cached_property
    def _last(self) -> list[Array]:
        """The strains that were found last: where the next search begins."""
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
