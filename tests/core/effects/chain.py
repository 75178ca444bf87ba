"""A planar chain under gravity and one tendon, pulled slowly: an independent program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.core.effects.cases import Array


@dataclass(frozen=True)
class Chain:
    """A tapered rod of links that stretch and bend, hanging in the plane of one exact tendon.

    Attributes
    ----------
    radius, offset, taper : (n,)
        Radius of the body [m], offset [m] of the tendon and the derivative of the offset, at the
        middle of the links; offset and derivative are 0 beyond the end of the tendon.
    length, E, specific_weight : float
        [m], [Pa], [N/m3].
    """

    radius: Array
    offset: Array
    taper: Array
    length: float
    E: float
    specific_weight: float

    @property
    def h(self) -> float:
        """The length of a link [m]."""
        return self.length / self.radius.size

    def slope(self, strains: Array, tension: float) -> Array:
        """Return the gradient [J] of the energy (2 n, ...): curvatures times length, stretches."""
        n = self.radius.size
        curvature, stretch = strains[:n] / self.length, strains[n:]
        column = (n, *(1,) * (strains.ndim - 1))
        R = self.radius.reshape(column)
        y = self.offset.reshape(column)
        EA = self.E * np.pi * R**2
        EJ = EA * R**2 / 4
        along = stretch - y * curvature
        pull = (
            np.where(y > 0, tension, 0.0)
            * along
            / np.sqrt(along**2 + self.taper.reshape(column) ** 2)
        )
        angle = self.h * (np.cumsum(curvature, axis=0) - curvature / 2)
        weight = self.specific_weight * np.pi * R**2 * self.h
        beyond = weight[::-1].cumsum(axis=0)[::-1] - weight / 2
        turned = self.h * beyond * stretch * np.sin(angle)
        by_curvature = self.h * (EJ * curvature - y * pull)
        by_curvature = by_curvature + self.h * (turned[::-1].cumsum(axis=0)[::-1] - turned / 2)
        by_stretch = self.h * (EA * (stretch - 1) + pull - beyond * np.cos(angle))
        return np.concatenate([by_curvature / self.length, by_stretch])

    def pulled(self, tensions: Array) -> Array:
        """Return the tip (2,) [m], sideways and down, after tensions that grow one by one.

        Newton's method uses derivatives by complex steps. Raises AssertionError if the chain
        becomes unstable.
        """
        n = self.radius.size
        strains = np.concatenate([np.zeros(n), np.ones(n)])
        for tension in tensions:
            for _ in range(20):
                shifted = strains[:, None] + 1e-30j * np.eye(2 * n)
                hessian = self.slope(shifted, tension).imag / 1e-30
                step = -np.linalg.solve(hessian, self.slope(strains, tension))
                strains = strains + step
                if np.abs(step).max() < 1e-10:
                    break
            assert np.linalg.eigvalsh((hessian + hessian.T) / 2)[0] > 0
        curvature, stretch = strains[:n] / self.length, strains[n:]
        angle = self.h * (np.cumsum(curvature) - curvature / 2)
        return self.h * np.array([stretch @ np.sin(angle), stretch @ np.cos(angle)])
