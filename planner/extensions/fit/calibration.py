"""Calibrated arm: predictions, cross-validation, and the choice of the next measurement.

The next shape to measure is the D-optimal one: the shape that adds most to the logarithm of the
determinant of the information matrix,

    1/2 log det(I + J M^-1 J^T),

with the Jacobian J of the shape's residuals over the noise, and the present information matrix M.
Source: Atkinson, Donev, Tobias, "Optimum Experimental Designs, with SAS" (2007), chapter 11.
The bounds enter as a uniform prior distribution, so that M is regular.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from octoplan.model import InputError
from octoplan.model.paths import Array
from octoplan.model.support.checks import finite_array, kind, numbers
from octoplan.model.support.progress import track
from octoplan.model.support.text import TextRepr
from octoplan.planner.entry_points import PLOT_CALIBRATION, SAVE_CALIBRATION, load
from octoplan.planner.extensions.fit.fitted import Fitted, checked_level
from octoplan.planner.extensions.fit.identifiability import UNIFORM
from octoplan.planner.extensions.fit.least_squares import fit
from octoplan.planner.extensions.fit.measured import MIDLINE, Measured, Point, checked_shapes
from octoplan.planner.extensions.fit.residuals import (
    Evaluation,
    Residual,
    UnsettledShapeError,
    from_rest,
    mean_distance,
)
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan

# Eigenvalues of I - H_ii below which only this shape determines a combination of its data.
_ALONE = 1e-3
_POINTS = "(s, (o_t, o_n, o_b)) for each, in m"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CalibratedPlan(Plan):
    """A plan of a calibrated arm.

    Attributes
    ----------
    tip_std : float
        Standard deviation of the distance between the actual and the planned tip [m], from the
        standard errors of the arm's parameters.
    measured_std : float
        Standard deviation of the distance between a measured and the planned tip [m], including
        the model error that cross-validation shows.
    evidence : str
        Source of the standard deviations if there are few surplus data; see Fitted.
    """

    tip_std: float
    measured_std: float
    evidence: str

    def _compose_outcome(self) -> str:
        plan = super()._compose_outcome()
        if not np.isfinite(self.tip_std):
            return f"{plan} By the calibration: {self.evidence}"
        sure = f"tip sure to {1e3 * self.tip_std:.2g} mm (one standard deviation)"
        missed = f"{1e3 * self.measured_std:.2g} mm with what the model misses of measured shapes"
        said = f"{plan} By the calibration, {sure}, {missed}."
        return f"{said} {self.evidence}".rstrip()


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted tip and points of a shape, with prediction bands.

    Attributes
    ----------
    tip : (3,)
        [m].
    std : (3, 3)
        Covariance matrix of the tip from the standard errors of the unknowns [m2]: the uncertainty
        of the calibrated arm's tip if the model is right. Unknowns that the data do not identify
        have the uncertainty of their bounds. The diagonal is inf if standard errors are unknown.
    places : (P, 3)
        Predicted positions of the points, or of the tip unless points were given [m].
    covariance : (P, 3, 3)
        Covariance matrices of measured positions [m2]: the uncertainty of the unknowns, propagated
        to the points, plus the model error.
    model_error : (P,)
        Standard deviation of a coordinate due to model error [m], from the errors of
        cross-validation at the same arc length.
    freedom : float
        Degrees of freedom of the model error: the number of shapes times the fraction of data that
        the unknowns leave free, because the errors of one shape's markers have one cause; inf if
        standard deviations apply as given.
    """

    tip: Array
    std: Array
    places: Array
    covariance: Array
    model_error: Array
    freedom: float

    @property
    def tip_std(self) -> float:
        """Standard deviation of the distance between the actual and the predicted tip [m]."""
        return float(np.sqrt(np.trace(self.std)))

    def band(self, level: float = 0.95) -> Array:
        """Return the half widths of the prediction intervals by coordinate (P, 3) [m]."""
        spread = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        half = (1 + checked_level(level)) / 2
        return np.asarray(scipy.special.stdtrit(self.freedom, half) * spread)

    def holds(self, places: Any, level: float = 0.95) -> Array:
        """Return whether measured positions (P, 3) [m] lie in the prediction ellipsoids (P,).

        The ellipsoids have the dimension of the measured coordinates; the others are NaN.
        """
        level = checked_level(level)
        places = numbers("places", places, "positions, with NaN for coordinates not measured")
        is_measured = ~np.isnan(places)
        given = finite_array("places", np.where(is_measured, places, 0.0), self.places.shape)
        if not np.isfinite(self.covariance).all():
            return np.ones(len(given), dtype=bool)
        rows = zip(given - self.places, self.covariance, is_measured, strict=True)
        return np.array([self._holds(off[m], C[np.ix_(m, m)], level) for off, C, m in rows])

    def _holds(self, off: Array, covariance: Array, level: float) -> bool:
        """Return whether an error (n,) [m] lies in the ellipsoid of its covariance (n, n)."""
        n = off.size
        largest = scipy.special.chdtri(n, 1 - level)
        if np.isfinite(self.freedom):
            largest = n * scipy.special.fdtri(n, self.freedom, level)
        return bool(off @ np.linalg.solve(covariance, off) <= largest)


@dataclass(frozen=True)
class LeftOut:
    """Cross-validation: shapes that were left out, predicted by fits to the other shapes.

    Attributes
    ----------
    residuals : tuple of Residual
        Prediction errors of all shapes, each from the fit without the shape.
    values : tuple of tuple of float
        Values of the unknowns, by fit.
    held : tuple of bool
        Whether each marker lies in its 95 % prediction ellipsoid.
    """

    residuals: tuple[Residual, ...]
    values: tuple[tuple[float, ...], ...]
    held: tuple[bool, ...]

    @property
    def mean_error(self) -> float:
        """Mean distance between measured and predicted positions of markers and tips [m]."""
        return mean_distance(self.residuals)


class Candidate(NamedTuple):
    """A shape that could be measured.

    Attributes
    ----------
    place : int
        Index among the candidates.
    tensions : tuple of float
        [N].
    gain : float
        Information gain [nats]; 0 if the shape does not settle.
    shrink : tuple of float
        Factors by which the standard errors (K,) shrink.
    """

    place: int
    tensions: tuple[float, ...]
    gain: float
    shrink: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class Calibration(TextRepr, Fitted):
    """A calibrated arm; see Fitted for the attributes."""

    def predict(
        self,
        tensions: Any = None,
        points: Sequence[tuple[float, Any]] = (),
        session: str = "",
        *,
        lengths: Any = None,
        strokes: Any = None,
    ) -> Prediction:
        """Predict the positions of points under tensions, with prediction bands.

        Each point has an arc length [m] and an offset (3,) [m]. Without points, predict the tip.
        Pass `lengths` or `strokes` as in Measured for tendons that winches hold; the calibrated
        zeros are added.
        """
        # Unknown marker positions must not move the points given here: number these points after
        # the markers, and replace the markers by unseen ones.
        unseen = [Point(0.0, MIDLINE, None)] * len(self.parameters.given.points)
        for i, point in enumerate(kind("points", points, Iterable, _POINTS)):
            if not isinstance(point, tuple | list) or len(point) != 2:
                raise InputError(f"points[{i}]", point, _POINTS)
        places = [*unseen, *(Point(s, offset, MIDLINE) for s, offset in points)]
        self._check_session(session)
        shape = Measured(
            tensions=tensions,
            points=tuple(places),
            tip=MIDLINE,
            lengths=lengths,
            strokes=strokes,
            session=session,
            name="the prediction",
        ).with_flat_tensions(self.given_arm)
        there = from_rest(self.experiment([shape]), self.array)
        for reason in there.failed.values():
            raise UnsettledShapeError(shape.name, reason)
        return self._predicted(there, len(points) or 1)

    def plan(self, targets: Any, **options: Any) -> Plan:
        """Plan for the calibrated arm, and add the uncertainty of the tip to the outcome.

        Pass the arguments of `plan`; the scene is the calibrated one.
        """
        planned = plan(self.arm, targets, self.scene, **options)
        predicted = self.predict(planned.tensions)
        measured = float(np.sqrt(np.trace(predicted.covariance[0])))
        result = CalibratedPlan(
            planned.problem,
            planned.solution,
            tip_std=predicted.tip_std,
            measured_std=measured,
            evidence=self.evidence,
        )
        result.copy_results(planned)
        return result

    def next(self, candidates: Sequence[Any], session: str = "") -> tuple[Candidate, ...]:
        """Rank sets of tensions by the information gain of a measurement, best first.

        The markers are the ones of the session's first shape, or else of the first shape of all;
        see Candidate.
        """
        sets = list(kind("candidates", candidates, Iterable, "a sequence of tensions"))
        if not sets:
            raise InputError("candidates", candidates, "at least one set of tensions")
        self._check_session(session)
        like = next((m for m in self.measured if m.session == session), self.measured[0])
        shapes = []
        for i, T in enumerate(sets):
            name = f"candidates[{i}]"
            flat = tuple(self.given_arm.flat(T, name).tolist())
            shapes.append(replace(like, tensions=flat, session=session, name=name))
        there = from_rest(self.experiment(shapes), self.array)
        J = self.all_jacobians
        M = J.T @ J + np.eye(J.shape[1]) / UNIFORM
        before = np.diag(np.linalg.inv(M))
        rows = list[Candidate]()
        scaled = there.scaled(self.noise)
        for i, shape in enumerate(shapes):
            gain = 0.0
            shrink = np.ones(len(before))
            if i in scaled:
                J_i = scaled[i][1]
                M_i = M + J_i.T @ J_i
                gain = float(np.linalg.slogdet(M_i)[1] - np.linalg.slogdet(M)[1]) / 2
                shrink = np.sqrt(np.diag(np.linalg.inv(M_i)) / before)
            rows.append(Candidate(i, shape.tensions, gain, tuple(shrink.tolist())))
        return tuple(sorted(rows, key=lambda candidate: -candidate.gain))

    def leave_out(self, groups: Sequence[Any] | None = None) -> LeftOut:
        """Cross-validate: predict shapes by fits without them.

        One shape is left out at a time. With `groups`, a label for each shape, all shapes with the
        same label are left out at a time.
        """
        allowed = f"a label for each of {len(self.measured)} shapes"
        each = range(len(self.measured)) if groups is None else groups
        labels = list(kind("groups", each, Iterable, allowed))
        if len(labels) != len(self.measured):
            raise InputError("groups", len(labels), allowed)
        if len(set(labels)) < 2:
            raise InputError("groups", labels, "two labels or more: some shapes have to stay")
        whole = self.evaluation
        values = list[tuple[float, ...]]()
        held = list[bool]()
        rows = dict[int, tuple[Residual, ...]]()
        for label in track("shapes left out", list(dict.fromkeys(labels))):
            others = whole.only([i for i in whole.equilibria if labels[i] != label])
            refit = fit(others, self.loss, self.absolute_std)
            at = refit.evaluation.values
            values.append(tuple(at.tolist()))
            without = replace(self, values=values[-1], noise=refit.noise, known=refit.evaluation)
            for i in (i for i in whole.equilibria if labels[i] == label):
                there = whole.only([i]).near(at)
                if there.equilibria:
                    rows[i] = tuple(there.named())
                    places = self.measured[i].places
                    held += without._predicted(there, len(places)).holds(places).tolist()
        residuals = tuple(row for i in sorted(rows) for row in rows[i])
        return LeftOut(residuals, tuple(values), tuple(held))

    def errors(self, measured: Sequence[Measured]) -> tuple[Residual, ...]:
        """Return predictions minus measurements for other shapes of this arm."""
        shapes = checked_shapes(self.given_arm, measured)
        return tuple(from_rest(self.experiment(shapes), self.array).named())

    def _check_session(self, session: str) -> None:
        sessions = {shape.session for shape in self.measured}
        if session and session not in sessions:
            names = ", ".join(sorted(sessions - {""}))
            raise InputError("session", session, f"one of {names}" if names else "omitted")

    def _predicted(self, there: Evaluation, count: int) -> Prediction:
        """Return the prediction of the first `count` places of an evaluation's only shape."""
        (i,) = there.equilibria
        shape = there.experiment.shapes[i]
        J = there.place_jacobian(i) * self.parameters.range
        places = there.predicted_places(i)
        parameter_covariance = J @ self.information[1] @ J.transpose(0, 2, 1)
        error = self._model_error(shape.arc_lengths(self.arm))[:count]
        band = parameter_covariance[:count] + error[:, None, None] ** 2 * np.eye(3)
        if self.is_uncertain:
            infinite = np.diag([np.inf] * 3)
            parameter_covariance = np.broadcast_to(infinite, parameter_covariance.shape)
            band = np.broadcast_to(infinite, band.shape)
            error = np.full(count, np.inf)
        # The errors of one shape's markers have one cause, and count as one degree of freedom.
        surplus = self.degrees_of_freedom / sum(shape.size for shape in self.explained)
        freedom = np.inf if self.uses_given_std else max(surplus * len(self.explained), 1.0)
        return Prediction(
            tip=places[-1],
            std=parameter_covariance[-1],
            places=places[:count],
            covariance=band,
            model_error=error,
            freedom=freedom,
        )

    def _model_error(self, s: Array) -> Array:
        """Return the standard deviation of a coordinate at arc lengths s (N,) [m].

        The root mean square error of cross-validation by marker, interpolated linearly between
        markers; without markers, the noise of the measurements.
        """
        shapes = {i: self.measured[i] for i in self.jacobians}
        at = np.concatenate([shape.arc_lengths(self.arm) for shape in shapes.values()])
        if not at.size:
            stds = [shape.place_std for shape in self.measured]
            return np.full(s.size, self.noise * np.mean(stds))
        errors = self._deleted_squares()
        rows = [np.full(shape.places.shape, np.nan) for shape in shapes.values()]
        for row, (i, shape) in zip(rows, shapes.items(), strict=True):
            is_measured = ~np.isnan(shape.places)
            row[is_measured] = errors[i][: np.count_nonzero(is_measured)]
        squares = np.nanmean(np.vstack(rows), axis=1)
        nodes = np.unique(np.round(at, 9))
        by_node = [np.sqrt(np.mean(squares[np.isclose(at, node)])) for node in nodes]
        return np.asarray(np.interp(s, nodes, by_node))

    def _deleted_squares(self) -> dict[int, Array]:
        """Return squared residuals (size,) of each shape by a fit without it, to first order.

        (I - H_ii)^-1 r_i with H = J (J^T J)^-1 J^T, in blocks of shapes: the residuals of one shape
        share causes, which the leverage of a single datum does not show. Priors are additional rows
        of J. Source: Cook and Weisberg, "Residuals and Influence in Regression" (1982), 4.2.

        Combinations of a shape's data that no other shape determines have no such residual. Their
        square is the variance of the noise.
        """
        J = self.all_jacobians
        inverse = np.linalg.pinv(J.T @ J, hermitian=True)
        squares = dict[int, Array]()
        scaled = self.evaluation.scaled()
        for i, J_i in self.jacobians.items():
            eigenvalues, basis = np.linalg.eigh(np.eye(len(J_i)) - J_i @ inverse @ J_i.T)
            kept = eigenvalues > _ALONE
            back = np.linalg.solve(self.evaluation.whitening[i], basis)
            deleted = back[:, kept] @ (basis[:, kept].T @ scaled[i][0] / eigenvalues[kept])
            alone = np.square(self.noise * back[:, ~kept]).sum(axis=1)
            squares[i] = np.square(deleted) + alone
        return squares

    def save(self, path: str | Path) -> Path:
        """Write the calibration to a .json file, which `load_calibration` reads."""
        written: Path = load(SAVE_CALIBRATION)(self, path)
        return written

    def plot(self, ax: Any = None) -> Any:
        """Draw markers and settled arms, residuals in measuring order, and standard errors.

        Draw the residuals alone in `ax` if given. Return the new Figure, or the axes.
        """
        return load(PLOT_CALIBRATION)(self, ax=ax)
