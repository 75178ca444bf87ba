"""Tendons of a measured shape: tensions, and lengths that winches hold, with zeros and stretch.

A winch that leaves the length L of unstretched tendon between base and anchorage, and o outside the
base, holds a tendon of tension T at the length

    l = L + (L + o) T / EA,    L = rest - stroke - zero    or    L = length - zero.

The same equations predict the encoders of tendons whose tensions are measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.sensitivities import ParameterSensitivities
from octoplan.model.extensions.lengths.winches import Winches
from octoplan.model.paths import Array, Mask
from octoplan.planner.extensions.fit.measured import Measured

# Relative singular values of dl/dT below which lengths do not determine tensions.
_UNDETERMINED = 1e-9


class SessionParameters(NamedTuple):
    """Quantities of equations, sensors and winches that depend on the unknowns.

    Derivatives of these quantities have a last axis of size K.

    Attributes
    ----------
    p : (n_p,)
        Parameters of the equations.
    lengths : (n,)
        Parameters of the tendons' lengths.
    nodes : (N + 1,)
        Arc lengths of the nodes [m].
    s : (M,)
        Arc lengths of the sensors [m].
    offsets : (M, 3)
        Offsets of the sensors in the local frame [m].
    scale : (n_tendons,)
        Factors of the tensions.
    rest : (n_tendons,)
        Lengths of the tendons at rest [m]; 0 unless strokes are measured.
    zero : (n_tendons,)
        Length taken in when the encoder of strokes reads 0 [m].
    tendon_EA : ()
        Axial stiffness of the tendons [N]; 0 for inextensible tendons.
    outside : ()
        Length of each tendon between winch and base [m].
    """

    p: Array
    lengths: Array
    nodes: Array
    s: Array
    offsets: Array
    scale: Array
    rest: Array
    zero: Array
    tendon_EA: Array
    outside: Array


@dataclass(frozen=True, eq=False)
class Drive:
    """The tendons of a shape at values of the unknowns.

    Attributes
    ----------
    shape : Measured
    at : SessionParameters
    """

    shape: Measured
    at: SessionParameters

    @property
    def held(self) -> Mask:
        """Whether a winch holds each tendon (n_tendons,)."""
        return np.array(self.shape.held, dtype=bool)

    @property
    def tensions(self) -> Array:
        """Given tensions (n_tendons,) [N]; 0 for tendons that are held or slack."""
        return np.asarray(self.at.scale * self._measured_tensions)

    @property
    def winches(self) -> Winches:
        """The winches that hold tendons, and the tensions of the others."""
        strokes = self.shape.strokes if self.shape.lengths is None else self.shape.lengths
        readings = np.nan_to_num(np.array(strokes, dtype=float))
        left = readings if self.shape.lengths is not None else self.at.rest - readings
        EA = float(self.at.tendon_EA) or np.inf
        lengths = np.where(self.held, left - self.at.zero, 0.0)
        return Winches(self.held, lengths, self.tensions, EA, float(self.at.outside))

    def sensitivities(
        self, equilibrium: Equilibrium, by: SessionParameters
    ) -> ParameterSensitivities:
        """Return the derivatives of the equilibrium with respect to the unknowns.

        `by` are the derivatives of the parameters.
        """
        given = self._measured_tensions[:, None] * by.scale
        if not self.shape.by_length:
            return ParameterSensitivities(equilibrium, by.p, by.lengths, given)
        at_given = ParameterSensitivities(equilibrium, by.p, by.lengths, given)
        T = equilibrium.tensions[:, None]
        L = self.winches.lengths[:, None]
        c = self._compliance
        left = (by.rest if self.shape.lengths is None else 0.0) - by.zero
        stretch = (L + self.at.outside) * T * self._compliance_changes(by) + c * T * by.outside
        lengths = left * (1 + c * T) + stretch - at_given.lengths
        tensions = given + self._by_lengths(equilibrium) @ lengths
        return ParameterSensitivities(equilibrium, by.p, by.lengths, tensions)

    def input_tensions(self, equilibrium: Equilibrium) -> Array:
        """Return the tensions (n_tendons, n_tendons) per standard deviation of each input [N].

        The inputs are the measured tensions, and the readings of the winches that hold tendons.
        """
        is_given = np.array([T is not None for T in self.shape.tensions or [None] * self.held.size])
        std = self.shape.tension_std * self.at.scale * is_given
        by_lengths = self._by_lengths(equilibrium)
        readings = self.shape.tendon_std * (1 + self._compliance * equilibrium.tensions)
        pulls = np.eye(std.size) - by_lengths @ equilibrium.length_tension
        return np.asarray(by_lengths * readings + pulls * std)

    def readings(self, equilibrium: Equilibrium) -> list[float]:
        """Return the predictions of Measured.tendon_residuals [m]."""
        rows = self.shape.tendon_residuals
        if not rows:
            return []
        left = self._unstretched(equilibrium)
        values = {"lengths": left + self.at.zero, "strokes": self.at.rest - left - self.at.zero}
        return [float(values[kind][j]) for kind, j in rows]

    def reading_changes(
        self,
        equilibrium: Equilibrium,
        change: ParameterSensitivities | None,
        by: SessionParameters | None,
    ) -> Array:
        """Return the changes of `readings` by the unknowns (rows, K).

        Without unknowns (None), return the changes by the tensions (rows, n_tendons) [m/N].
        """
        rows = self.shape.tendon_residuals
        if not rows:
            return np.zeros((0, 1))
        n = self.held.size
        lengths = equilibrium.length_tension if change is None else change.lengths
        dT = np.eye(n) if change is None else change.tensions
        T = equilibrium.tensions[:, None]
        c = self._compliance
        L = self._unstretched(equilibrium)[:, None]
        stretch = (L + self.at.outside) * c * dT
        zero = np.zeros_like(lengths)
        rest = zero
        if by is not None:
            stretch = stretch + (L + self.at.outside) * T * self._compliance_changes(by)
            stretch = stretch + c * T * by.outside
            zero = by.zero
            rest = by.rest
        left = (lengths - stretch) / (1 + c * T)
        values = {"lengths": left + zero, "strokes": rest - left - zero}
        return np.array([values[kind][j] for kind, j in rows])

    @property
    def _measured_tensions(self) -> Array:
        """Measured tensions (n_tendons,) [N]; 0 for tendons without."""
        given = self.shape.tensions or [0.0] * self.held.size
        return np.asarray(np.nan_to_num(np.array(given, dtype=float)))

    @property
    def _compliance(self) -> float:
        """Strain of the tendons per tension [1/N]."""
        EA = float(self.at.tendon_EA)
        return 1 / EA if EA else 0.0

    def _compliance_changes(self, by: SessionParameters) -> Array:
        """Return the derivatives of the compliance (K,) [1/N]."""
        return np.asarray(-(self._compliance**2) * by.tendon_EA)

    def _unstretched(self, equilibrium: Equilibrium) -> Array:
        """Return the unstretched lengths of the tendons between base and anchorage (n_tendons,)."""
        strain = self._compliance * equilibrium.tensions
        return np.asarray((equilibrium.lengths - self.at.outside * strain) / (1 + strain))

    def _by_lengths(self, equilibrium: Equilibrium) -> Array:
        """Return dT/dl for the lengths of taut tendons that winches hold (n_tendons, n_tendons)."""
        if not self.shape.by_length:
            return np.zeros((self.held.size, self.held.size))
        taut = self.held & (equilibrium.tensions > 0)
        M = equilibrium.length_tension - np.diag(self.winches.stretch)
        return np.linalg.pinv(np.where(np.outer(taut, taut), M, 0.0), _UNDETERMINED)
