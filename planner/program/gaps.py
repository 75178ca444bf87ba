"""The inequalities that keep an arm clear, as part of a program in symbols, with derivatives.

They come from kernels of two or four poses (planner.avoidance.rows): their Jacobians and Hessians
are put into sparse matrices, so that a program with other inequalities is soon built.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.arm import Arm
from model.stations import base_pose
from model.transcription.layout import POSE
from model.transcription.terms import Equations
from planner.avoidance.rows import Avoidance


@dataclass(frozen=True, eq=False)
class Gaps:
    """How much farther off than they have to be places are, over L, of poses (7, K) at stations.

    Attributes
    ----------
    equations : Equations or None
        See Avoidance.gaps; None where nothing is to be kept clear of.
    base : (7,)
        The pose that the arm is clamped at.
    """

    equations: Equations | None
    base: ca.DM
    length: float

    @classmethod
    def of(
        cls, arm: Arm, avoidance: Avoidance | None, stations: tuple[float, ...], machine_code: bool
    ) -> Gaps:
        """Return the gaps of inequalities; CasADi cannot differentiate compiled ones."""
        found = avoidance.gaps(arm, stations, machine_code) if avoidance else None
        return cls(found, ca.DM(base_pose(arm)), arm.length)

    @property
    def size(self) -> int:
        """How many there are."""
        return self.equations.n_g if self.equations else 0

    @property
    def n_numbers(self) -> int:
        """How many numbers they take."""
        return self.equations.n_p if self.equations else 0

    def value(self, poses: ca.MX, p: ca.MX) -> ca.MX:
        """Return the gaps (m,)."""
        if self.equations is None:
            return ca.MX(0, 1)
        return self.equations.value(self._all(poses), p) / self.length

    def jacobian(self, poses: ca.MX, p: ca.MX) -> ca.MX:
        """Return their derivatives by the poses, column by column (m, 7 K)."""
        if self.equations is None:
            return ca.MX(0, poses.numel())
        function, places = self.equations.jacobian
        return ca.MX(places, function(self._all(poses), p))[:, POSE:] / self.length

    def second(self, poses: ca.MX, p: ca.MX, weights: ca.MX) -> ca.MX:
        """Return the Hessian (7 K, 7 K) of weights (m,) . gaps."""
        if self.equations is None:
            return ca.MX(poses.numel(), poses.numel())
        function, places = self.equations.hessian
        nonzeros = function(self._all(poses), p, weights)
        return ca.MX(places, nonzeros)[POSE:, POSE:] / self.length

    def _all(self, poses: ca.MX) -> ca.MX:
        return ca.vertcat(self.base, ca.vec(poses))
