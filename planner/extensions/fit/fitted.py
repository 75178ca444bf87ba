"""Fitted values of an arm's parameters, with standard errors and diagnostics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from octoplan.model import Arm, Scene
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.extensions.lengths.winches import PLAIN_WINCHES, WinchSettings
from octoplan.model.paths import Array
from octoplan.model.support.checks import within
from octoplan.model.support.text import counted
from octoplan.planner.extensions.fit.experiment import Experiment
from octoplan.planner.extensions.fit.identifiability import Direction, direction, information
from octoplan.planner.extensions.fit.least_squares import Loss, degrees_of_freedom, loss_weights
from octoplan.planner.extensions.fit.measured import Measured, crushing_remark
from octoplan.planner.extensions.fit.orders import Order
from octoplan.planner.extensions.fit.residuals import (
    Evaluation,
    Residual,
    from_rest,
    mean_distance,
    unreached,
)
from octoplan.planner.extensions.fit.unknowns import WORSE, Parameters, Unknown

# Standard error over the standard deviation of the prior above which the data add nothing.
_UNMOVED = 0.9
# Residuals of a shape over the residuals of the median shape above which the shape is an outlier.
_UNLIKE = 3.0
# Degrees of freedom from which on the outcome omits the width of Student's t intervals; at 10,
# intervals of 95 % are 12 % wider than normal ones.
_MANY = 10


class Start(NamedTuple):
    """Initial values of a fit, the final values, and the misfit.

    The misfit is the negative log-likelihood up to a constant. If the fit failed, `found` is
    None and `why` is the reason.
    """

    values: tuple[float, ...]
    found: tuple[float, ...] | None
    misfit: float
    why: str = ""


@dataclass(frozen=True)
class Fitted:
    """An arm with fitted parameters.

    Attributes
    ----------
    given_arm, given_scene
        Arm and scene before the fit.
    measured : tuple of Measured
    unknowns : tuple of Unknown
    values : tuple of float
        Estimates of the unknowns, in the units of their keys.
    noise : float
        Factor of the standard deviations of the measurements; 1 without surplus data.
    loss : str
        Loss function of the residuals over the noise; see calibrate.
    absolute_std : bool
        Whether standard deviations of the measurements apply as given.
    refinement, stages : int
        Refinement of the mesh, and number of collocation stages.
    error : float
        Estimated error of predictions due to the mesh, over the arm's length.
    starts : tuple of Start
        Initial and final values of each fit, the given values first.
    astray : tuple of str
        Shapes that a fit had on another branch than the arm reaches from rest, which made the fit
        restart.
    left_out : tuple of (str, str)
        Shapes that the fit excludes, each with the reason: near the estimate these shapes jump or
        do not settle.
    stopped : bool
        Whether the time limit stopped the fit before the optimum.
    machine_code : bool
        Whether shapes are settled by compiled kernels.
    blocked : tuple of (str, str)
        Shapes that ended the fit at a limit beyond which they do not settle, each with the reason.
    given_winches : WinchSettings
        Zeros and stretch of the winches before the fit.
    orders : tuple of Order
        Orders of the measured tendons that were tried because of a bad fit, the one in use first.
        The tendons of `measured` are in this order.
    known : Evaluation or None
        Shapes at the estimate, if already evaluated; neither saved nor pickled.
    """

    given_arm: Arm
    given_scene: Scene
    measured: tuple[Measured, ...]
    unknowns: tuple[Unknown, ...]
    values: tuple[float, ...]
    noise: float
    loss: Loss
    absolute_std: bool
    refinement: int
    error: float
    starts: tuple[Start, ...]
    astray: tuple[str, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    stopped: bool = False
    machine_code: bool = field(default=False, compare=False)
    stages: int = STAGES
    blocked: tuple[tuple[str, str], ...] = ()
    given_winches: WinchSettings = PLAIN_WINCHES
    orders: tuple[Order, ...] = ()
    known: Evaluation | None = field(default=None, compare=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without results that can be recomputed."""
        state = {item.name: getattr(self, item.name) for item in fields(self)}
        return state | {"known": None}

    @property
    def arm(self) -> Arm:
        """The calibrated arm; see `setting` for the arm of a session."""
        return self.setting()[0]

    @property
    def scene(self) -> Scene:
        """The calibrated scene."""
        return self.setting()[1]

    def setting(self, session: str = "") -> tuple[Arm, Scene]:
        """Return the arm and the scene of a session."""
        setting = self.parameters.setting(self.array, session)
        return setting.arm, setting.scene

    @property
    def winches(self) -> WinchSettings:
        """The calibrated zeros of the winches and stretch of the tendons."""
        return self.parameters.setting(self.array).winches

    @property
    def array(self) -> Array:
        """The values (K,)."""
        return np.array(self.values)

    @property
    def std(self) -> Array:
        """Standard errors of the values (K,), in their units; inf for unidentified unknowns.

        Without surplus data, standard errors are propagated from the given standard deviations of
        the measurements, and are inf unless these deviations are given.
        """
        return np.sqrt(np.diag(self.information[0])) * self.parameters.range

    @property
    def covariance(self) -> Array:
        """Covariance matrix of the values (K, K), in the units of their keys."""
        return np.asarray(self.information[0] * np.outer(*[self.parameters.range] * 2))

    def interval(self, level: float = 0.95) -> Array:
        """Return the values' confidence intervals (K, 2)."""
        half = self.quantile(level) * self.std
        return np.column_stack([self.array - half, self.array + half])

    def quantile(self, level: float) -> float:
        """Return the half width of an interval in standard errors."""
        half = (1 + checked_level(level)) / 2
        if self.uses_given_std:
            return float(scipy.special.ndtri(half))
        return float(scipy.special.stdtrit(self.degrees_of_freedom, half))

    @cached_property
    def degrees_of_freedom(self) -> float:
        """Number of data minus the number of combinations of unknowns that the data determine.

        0 without surplus data, that is, if some values of the unknowns fit any data.
        """
        return degrees_of_freedom(self.evaluation, self.noise)

    @property
    def uses_given_std(self) -> bool:
        """Whether standard errors follow from the standard deviations of the measurements."""
        return self.absolute_std or not self.degrees_of_freedom

    @property
    def is_uncertain(self) -> bool:
        """Whether standard errors are unknown: without surplus data or standard deviations."""
        return self.uses_given_std and not all(shape.has_stds for shape in self.explained)

    @property
    def evidence(self) -> str:
        """Source of the standard errors, in one sentence; "" with many surplus data."""
        freedom = self.degrees_of_freedom
        if self.absolute_std or freedom >= _MANY:
            return ""
        if self.is_uncertain:
            return (
                "Standard errors are unknown: there are no surplus data, and no standard deviations"
                " of the measurements; give `std`, or measure more."
            )
        if not freedom:
            return (
                "There are no surplus data to test the standard deviations of the measurements: "
                "standard errors follow from these as given."
            )
        return (
            f"Only {freedom:.3g} surplus number{'s' * (freedom != 1)}: an interval of 95 % reaches "
            f"{self.quantile(0.95):.3g} standard errors to either side, by Student's t."
        )

    @property
    def explained(self) -> list[Measured]:
        """The shapes that are not left out."""
        return [self.measured[i] for i in self.evaluation.equilibria]

    @property
    def unidentified(self) -> tuple[Direction, ...]:
        """Combinations of unknowns that the data identify badly or not at all."""
        names = [unknown.name for unknown in self.unknowns]
        units = [self.parameters.unit(unknown) for unknown in self.unknowns]
        return tuple(
            direction(v, std, names, self.parameters.range, units)
            for v, std in self.information[2]
            if np.isinf(std) or not self.is_uncertain
        )

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of the unknowns that are at a bound."""
        return self.parameters.names_at_bounds(self.array)

    @property
    def at_priors(self) -> tuple[str, ...]:
        """Names of the unknowns whose priors the data do not improve."""
        if self.is_uncertain:
            return ()
        rows = zip(self.unknowns, self.std, strict=True)
        return tuple(
            unknown.name
            for unknown, std in rows
            if unknown.prior and std > _UNMOVED * unknown.prior[1]
        )

    @property
    def residuals(self) -> tuple[Residual, ...]:
        """All residuals, shape by shape, of the shapes that settle."""
        return tuple(self.evaluation.named())

    @property
    def mean_error(self) -> float:
        """Mean distance between measured and predicted markers and tips [m]; NaN without any."""
        return mean_distance(self.residuals)

    @property
    def unlike(self) -> tuple[str, ...]:
        """Names of outliers: shapes that fit far worse than the others.

        The root mean square of an outlier's residuals over the noise is above three times the one
        of the median shape, and above 1.
        """
        scaled = self.evaluation.scaled(self.noise)
        sizes = {i: float(np.sqrt(np.mean(np.square(r)))) for i, (r, _) in scaled.items()}
        far = max(_UNLIKE * float(np.median(list(sizes.values()))), 1.0)
        return tuple(self.measured[i].name for i, size in sizes.items() if size > far)

    @property
    def unreached(self) -> tuple[str, ...]:
        """Names of shapes that the fit does not reach.

        The mean error of their markers, tendon lengths or strokes is above a tenth of the arm's
        length.
        """
        return unreached(self.evaluation)

    @property
    def outcome(self) -> str:
        """Result of the fit, uncertainties, and remedies."""
        size = sum(shape.size for shape in self.measured)
        counts = [(len(self.measured), "shape"), (size, "number"), (len(self.unknowns), "unknown")]
        error = f"residuals are {self.noise:.3g} times the standard deviations given"
        if np.isfinite(self.mean_error):
            error = f"markers are {1e3 * self.mean_error:.3g} mm off in the mean"
        lines = [f"{', '.join(counted(n, what) for n, what in counts)}: {error}."]
        if self.stopped:
            lines.append("Stopped at the time limit: the values are the best so far.")
        lines += [
            f"The fit ended where {name} ceases to settle: {why}." for name, why in self.blocked
        ]
        lines += self._order_found()
        lines += [self.evidence] if self.evidence else []
        lines += [f"{line[0].upper()}{line[1:]}." for line in map(str, self.unidentified)]
        if self.at_bounds:
            lines.append(f"At a bound: {', '.join(self.at_bounds)}; widen it, or doubt the model.")
        if self.at_priors:
            lines.append(f"The data say no more than the prior of {', '.join(self.at_priors)}.")
        lines += [f"{name} is left out: {why}." for name, why in self.left_out]
        lines += self._outliers()
        if self.astray:
            lines.append(
                f"The fit had {', '.join(self.astray)} on a branch that the arm does not take from "
                "rest; it was begun again from there. Check for another optimum with more starts."
            )
        return " ".join([*lines, *self._agreement()])

    def _outliers(self) -> list[str]:
        """Return sentences on shapes that are not reached and on outliers."""
        lines = []
        far = self.unreached
        unlike = [name for name in self.unlike if name not in far]
        if far:
            lines.append(
                f"No values within the bounds reach {', '.join(far)}: markers or lengths are off "
                "by more than a tenth of the arm's length; check tensions and markers there, "
                "units, the order of the tendons, and the bounds. " + self._largest_residual(far)
            )
            if remark := crushing_remark(self.given_arm, self.measured):
                lines.append(remark)
        if unlike:
            fit = ", or fit with a robust loss" * (self.loss == "linear")
            lines.append(
                f"No values within the bounds reach {', '.join(unlike)} as well as the others: "
                f"check tensions and markers there{fit}. {self._largest_residual(unlike)}"
            )
        return lines

    def _largest_residual(self, names: Sequence[str]) -> str:
        """Return a sentence on the largest error of a marker, length or stroke in some shapes."""
        rows = [
            residual
            for residual in self.residuals
            if residual.shape in names and not residual.what.startswith("frames")
        ]
        if not rows:
            return "Frames are off."
        worst = max(rows, key=lambda residual: residual.size)
        return f"Farthest off is {worst.what} of {worst.shape}, by {1e3 * worst.size:.3g} mm."

    def _order_found(self) -> list[str]:
        """Return a sentence on the order of the tendons, if other orders were tried."""
        if not self.orders:
            return []
        best, *others = self.orders
        given = tuple(range(len(best.tendons)))
        names = self.given_arm.tendon_names
        if best.tendons == given:
            return [f"{len(others)} mirrored or shifted orders of the tendons fit no better."]
        before = next(order for order in others if order.tendons == given)
        line = (
            "The tendons act in another order than measured: "
            f"{', '.join(names[j] for j in best.tendons)} as {', '.join(names)}. In the given "
            f"order markers are {1e3 * before.mean_error:.3g} mm off; check the wiring"
        )
        equal = [order for order in others if order.misfit <= best.misfit + WORSE]
        line += f"; {counted(len(equal), 'more order')} fit as well" if equal else ""
        return [f"{line}."]

    def _agreement(self) -> list[str]:
        """Return a sentence on the number of starts that converged to the optimum."""
        if len(self.starts) == 1:
            return []
        best = min(start.misfit for start in self.starts)
        equal = [start for start in self.starts if start.misfit <= best + WORSE * abs(best) + WORSE]
        failed = sum(start.found is None for start in self.starts)
        worse = len(self.starts) - len(equal) - failed
        line = f"{len(equal)} of {len(self.starts)} starts came to this optimum"
        line += f", {worse} to worse ones" if worse else ""
        line += f", {failed} to no shapes that settle" if failed else ""
        first = self.starts[0]
        if first not in equal and first.found is not None:
            line += "; the given values lead to a worse one: it is another basin"
        return [f"{line}."]

    @cached_property
    def parameters(self) -> Parameters:
        """The unknowns, with the arm and the scene that contain them."""
        return parameters_of(
            self.given_arm, self.given_scene, self.unknowns, self.measured, self.given_winches
        )

    @cached_property
    def evaluation(self) -> Evaluation:
        """The shapes at the estimate, settled from rest, without the excluded shapes."""
        if self.known is not None:
            return self.known
        names = [name for name, _ in self.left_out]
        kept = [i for i, shape in enumerate(self.measured) if shape.name not in names]
        rest = from_rest(self.experiment(self.measured), self.array)
        return rest.only([i for i in kept if i in rest.equilibria]).relinearised()

    def experiment(self, shapes: Sequence[Measured]) -> Experiment:
        """Return the equations of shapes with the unknowns of this calibration."""
        return Experiment(
            parameters=self.parameters,
            shapes=shapes,
            refinement=self.refinement,
            stages=self.stages,
            machine_code=self.machine_code,
        )

    @cached_property
    def information(self) -> tuple[Array, Array, list[tuple[Array, float]]]:
        """Covariances and unidentified directions of unknowns in [0, 1]; see identifiability."""
        covariance, bounded, directions = information(self.all_jacobians)
        if self.is_uncertain:
            covariance[np.diag_indices(len(covariance))] = np.inf
        return covariance, bounded, directions

    @property
    def all_jacobians(self) -> Array:
        """Jacobian of the residuals of all shapes and of the priors (n, K)."""
        return np.vstack([*self.jacobians.values(), self.parameters.priors(self.array)[1]])

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Derivatives of each shape's residuals over the noise, by unknowns in [0, 1]."""
        return {
            i: J * np.sqrt(loss_weights(self.loss, r))[:, None]
            for i, (r, J) in self.evaluation.scaled(self.noise).items()
        }


def checked_level(level: Any) -> float:
    """Return the confidence level of an interval, or raise InputError."""
    return within("level", level, 0.0, np.nextafter(1.0, 0.0))


def parameters_of(
    arm: Arm,
    scene: Scene,
    unknowns: Iterable[Unknown],
    shapes: Sequence[Measured],
    winches: WinchSettings,
) -> Parameters:
    """Return the unknowns, with keys of the arm, the scene, the markers and the winches.

    The markers are the ones of the shape that has most. Raises InputError for unknown keys and
    sessions, and for unsuitable bounds.
    """
    points: Sequence[Any] = max((shape.points for shape in shapes), key=len, default=())
    sessions = sorted({shape.session for shape in shapes} - {""})
    return Parameters.of(arm, scene, unknowns, points, sessions, winches)
