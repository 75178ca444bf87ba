"""Fitted values, and all that follows from them: the arm, and how well it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from model import Arm, Scene
from model.equilibrium.forward import STAGES
from model.paths import Array
from planner.calibrate.experiment import Evaluation, Experiment
from planner.calibrate.fit import Weights, prior_rows
from planner.calibrate.identify import Direction, Information, direction, information
from planner.calibrate.measured import Measured
from planner.calibrate.residuals import Residual, mean_distance, residuals_of
from planner.calibrate.session import point_table
from planner.unknowns.parameters import Parameters
from planner.unknowns.unknown import Unknown

_AT_BOUND, _UNMOVED, _UNLIKE = 1e-6, 0.9, 3.0
# Markers that are off by such a share of the arm's length in the mean are not explained at all.
_UNREACHED = 0.1


class Start(NamedTuple):
    """Values that a fit began with, and where it came to."""

    values: tuple[float, ...]
    found: tuple[float, ...] | None
    misfit: float
    why: str = ""


@dataclass(frozen=True)
class Fitted:
    """An arm with fitted numbers.

    Attributes
    ----------
    given_arm, given_scene
        What it began with.
    measured : tuple of Measured
    unknowns : tuple of Unknown
    values : tuple of float
        Of the unknowns, in the units of their keys.
    noise : float
        What the standard deviations of the measurements are multiplied by.
    weights : Weights
    refinement, stages : int
        Of the meshes.
    error : float
        Estimated error of what is predicted, over the arm's length.
    starts : tuple of Start
        Where fits came to, the given values first.
    astray : tuple of str
        Shapes that the fit had on another branch than the arm takes from rest.
    machine_code : bool
        Whether shapes are found by compiled kernels.
    """

    given_arm: Arm
    given_scene: Scene
    measured: tuple[Measured, ...]
    unknowns: tuple[Unknown, ...]
    values: tuple[float, ...]
    noise: float
    weights: Weights
    refinement: int
    error: float
    starts: tuple[Start, ...]
    astray: tuple[str, ...] = ()
    machine_code: bool = field(default=False, compare=False)
    stages: int = STAGES

    def __getstate__(self) -> dict[str, Any]:
        """Return the numbers; what was worked out of them does not travel."""
        return {own.name: getattr(self, own.name) for own in fields(self)}

    @cached_property
    def arm(self) -> Arm:
        """The calibrated arm; see `setting` for what belongs to a session."""
        return self.setting()[0]

    @cached_property
    def scene(self) -> Scene:
        """The calibrated scene."""
        return self.setting()[1]

    @property
    def array(self) -> Array:
        """The values (K,)."""
        return np.array(self.values)

    def setting(self, session: str = "") -> tuple[Arm, Scene]:
        """Return arm and scene of a session."""
        return self.parameters.built(self.array, session)

    @property
    def std(self) -> Array:
        """Standard errors of the values (K,), in their units; inf where nothing tells."""
        return np.sqrt(np.diag(self.information.covariance)) * self.parameters.range

    def interval(self, level: float = 0.95) -> Array:
        """Return the values' confidence intervals (K, 2)."""
        values, half = self.array, self.quantile(level) * self.std
        return np.column_stack([values - half, values + half])

    @property
    def covariance(self) -> Array:
        """Of the values (K, K), in the units of their keys."""
        return np.asarray(self.information.covariance * np.outer(*[self.parameters.range] * 2))

    @cached_property
    def unidentified(self) -> tuple[Direction, ...]:
        """Combinations of unknowns that the data do not tell, or hardly."""
        names = [own.name for own in self.unknowns]
        units = [self.parameters.unit(own) for own in self.unknowns]
        return tuple(
            direction(v, std, names, self.parameters.range, units)
            for v, std in self.information.directions
        )

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of the unknowns that are at a bound."""
        share = (self.array - self.parameters.lower) / self.parameters.range
        ends = np.minimum(share, 1 - share) < _AT_BOUND
        return tuple(own.name for own, end in zip(self.unknowns, ends, strict=True) if end)

    @property
    def at_priors(self) -> tuple[str, ...]:
        """Names of the unknowns of which the data say no more than their priors."""
        return tuple(
            own.name
            for own, std in zip(self.unknowns, self.std, strict=True)
            if own.prior and std > _UNMOVED * own.prior[1]
        )

    @cached_property
    def residuals(self) -> tuple[Residual, ...]:
        """All that was measured, shape by shape."""
        return residuals_of(self.evaluation)

    @property
    def mean_error(self) -> float:
        """Mean distance of markers and tips from where they are predicted [m]; NaN without any."""
        return mean_distance(self.residuals)

    @cached_property
    def unlike(self) -> tuple[str, ...]:
        """Names of shapes that are far worse explained than the others.

        Their residuals over the noise are, in the mean, more than three times those of the median
        shape, and more than noise; no values within the bounds bring them nearer.
        """
        sizes = [
            float(np.sqrt(np.mean(np.square(miss / (shape.stds * self.noise)))))
            for shape, miss in zip(self.measured, self.evaluation.by_shape, strict=True)
        ]
        usual = float(np.median(sizes))
        far = max(_UNLIKE * usual, 1.0)
        return tuple(m.name for m, size in zip(self.measured, sizes, strict=True) if size > far)

    @cached_property
    def unreached(self) -> tuple[str, ...]:
        """Names of shapes that no values within the bounds come near.

        Their markers are off by more than a tenth of the arm's length in the mean.
        """
        far, found = _UNREACHED * self.given_arm.length, dict[str, list[float]]()
        for own in self.residuals:
            if own.is_place:
                found.setdefault(own.shape, []).append(own.size)
        return tuple(name for name, sizes in found.items() if np.mean(sizes) > far)

    @property
    def degrees_of_freedom(self) -> int:
        """Numbers measured, and priors, less unknowns; at least 1."""
        priors = sum(own.prior is not None for own in self.unknowns)
        return max(sum(m.size for m in self.measured) + priors - len(self.unknowns), 1)

    def quantile(self, level: float) -> float:
        """Return how many standard errors an interval reaches to either side."""
        half = (1 + level) / 2
        if self.weights.absolute:
            return float(scipy.special.ndtri(half))
        return float(scipy.special.stdtrit(self.degrees_of_freedom, half))

    @cached_property
    def parameters(self) -> Parameters:
        """The unknowns with what they are numbers of."""
        sessions = sorted({shape.session for shape in self.measured} - {""})
        points = point_table(self.measured)
        return Parameters.of(self.given_arm, self.given_scene, self.unknowns, points, sessions)

    @cached_property
    def evaluation(self) -> Evaluation:
        """All shapes at the values, as they are reached from rest."""
        return self.experiment(self.measured).at(self.array)

    def experiment(self, shapes: Sequence[Measured]) -> Experiment:
        """Return shapes with the unknowns of this calibration."""
        return Experiment(self.parameters, shapes, self.refinement, self.machine_code, self.stages)

    @cached_property
    def information(self) -> Information:
        """What data and priors say of the unknowns, from bound to bound."""
        return information(self.scaled_jacobian)

    @property
    def scaled_jacobian(self) -> Array:
        """Derivatives of residuals over noise, then of the priors, by unknowns from 0 to 1."""
        J = self.evaluation.jacobian * self.parameters.range / self.noise
        counted = np.sqrt(self.weights.jacobian(self.evaluation.residuals / self.noise))
        prior = prior_rows(self.evaluation.experiment, self.array)[1]
        return np.vstack([J * counted[:, None], prior])
