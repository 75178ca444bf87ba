"""A calibrated arm: what it predicts, how well it predicts shapes left out, what to measure next.

Which shapes to measure next (D-optimal): what one adds to the logarithm of the determinant of the
information matrix,

    1/2 log det(I + J M^-1 J^T),    J of its residuals over the noise, M the information so far.

Source: Atkinson, Donev, Tobias, "Optimum Experimental Designs, with SAS" (2007), chapter 11.
The bounds count as a uniform distribution, so that M is regular.
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
from octoplan.model.support.checks import finite_array, kind
from octoplan.model.support.progress import track
from octoplan.model.support.text import TextRepr
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
from octoplan.planner.frontends.io.files import to_json, write_named
from octoplan.planner.frontends.io.records import record
from octoplan.planner.frontends.io.saved_records import CalibrationRecord
from octoplan.planner.plan import Plan, plan

# Eigenvalues of I - H_ii below which a shape alone determines a combination of its numbers.
_ALONE = 1e-3
_POINTS = "(s, (o_t, o_n, o_b)) for each, in m"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CalibratedPlan(Plan):
    """A plan of a calibrated arm.

    Attributes
    ----------
    tip_std : float
        One standard deviation of the tip's distance from where it is planned [m], by the standard
        errors of the arm's numbers.
    measured_std : float
        The same of where it would be measured, with what the model misses of shapes left out [m].
    evidence : str
        What these follow from, if there are few surplus data; see Fitted.
    """

    tip_std: float
    measured_std: float
    evidence: str

    @property
    def outcome(self) -> str:
        """What was found, and how sure the tip is."""
        if not np.isfinite(self.tip_std):
            return f"{super().outcome} By the calibration: {self.evidence}"
        sure = f"tip sure to {1e3 * self.tip_std:.2g} mm (one standard deviation)"
        missed = f"{1e3 * self.measured_std:.2g} mm with what the model misses of measured shapes"
        said = f"{super().outcome} By the calibration, {sure}, {missed}."
        return f"{said} {self.evidence}".rstrip()


@dataclass(frozen=True, eq=False)
class Prediction:
    """The tip and points of a shape, with bands for what would be measured there.

    Attributes
    ----------
    tip : (3,)
        [m].
    std : (3, 3)
        Covariance matrix of the tip by the standard errors of the unknowns [m2]: how sure the
        calibrated arm's tip is, if the model is right. Where data tell nothing of the unknowns,
        their bounds do. It is inf on its diagonal if standard errors are unknown.
    places : (P, 3)
        Of the points [m]; the tip unless points were given.
    covariance : (P, 3, 3)
        Of what would be measured: that of the unknowns, carried to the points, and the model error.
    model_error : (P,)
        Standard deviation of a coordinate by which fits without a shape miss it at such an arc
        length [m].
    freedom : float
        Degrees of freedom of the model error: as many as shapes, less what the unknowns take of
        them, as what a shape's markers are missed by has one cause; inf if standard deviations hold
        as given.
    """

    tip: Array
    std: Array
    places: Array
    covariance: Array
    model_error: Array
    freedom: float

    @property
    def tip_std(self) -> float:
        """One standard deviation of the tip's distance from where it is predicted [m]."""
        return float(np.sqrt(np.trace(self.std)))

    def band(self, level: float = 0.95) -> Array:
        """Return the half widths of the band by coordinate (P, 3) [m]."""
        spread = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        half = (1 + checked_level(level)) / 2
        return np.asarray(scipy.special.stdtrit(self.freedom, half) * spread)

    def holds(self, places: Any, level: float = 0.95) -> Array:
        """Return whether measured places (P, 3) [m] lie in the points' ellipsoids (P,)."""
        level = checked_level(level)
        off = (finite_array("places", places, self.places.shape) - self.places)[:, :, None]
        if not np.isfinite(self.covariance).all():
            return np.ones(len(off), dtype=bool)
        size = (off * np.linalg.solve(self.covariance, off)).sum(axis=(1, 2))
        most = scipy.special.chdtri(3, 1 - level)
        if np.isfinite(self.freedom):
            most = 3 * scipy.special.fdtri(3, self.freedom, level)
        return np.asarray(size <= most)


@dataclass(frozen=True)
class LeftOut:
    """Shapes that were left out, as the others predict them.

    Attributes
    ----------
    residuals : tuple of Residual
        Of all shapes, each by the fit without it.
    values : tuple of tuple of float
        Of the unknowns, by fit.
    held : tuple of bool
        Whether each marker lies in its 95 % band.
    """

    residuals: tuple[Residual, ...]
    values: tuple[tuple[float, ...], ...]
    held: tuple[bool, ...]

    @property
    def mean_error(self) -> float:
        """Mean distance of markers and tips from where they are predicted [m]."""
        return mean_distance(self.residuals)


class Candidate(NamedTuple):
    """A shape that could be measured.

    Its `place` among the candidates, tensions [N], what it tells [nats], and by what factor the
    standard errors (K,) shrink; a shape that does not settle tells nothing.
    """

    place: int
    tensions: tuple[float, ...]
    gain: float
    shrink: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class Calibration(TextRepr, Fitted):
    """A calibrated arm; see Fitted for what it holds."""

    def predict(
        self, tensions: Any, points: Sequence[tuple[float, Any]] = (), session: str = ""
    ) -> Prediction:
        """Return where the tip and points (s [m], offset (3,) [m]) are under tensions, with bands.

        The band of the tip alone unless points are given.
        """
        flat = tuple(self.given_arm.flat(tensions).tolist())
        # Behind the markers, whose unknowns are not those of points that are said here.
        none = [Point(0.0, MIDLINE, None)] * len(self.parameters.given.points)
        for i, point in enumerate(kind("points", points, Iterable, _POINTS)):
            if not isinstance(point, tuple | list) or len(point) != 2:
                raise InputError(f"points[{i}]", point, _POINTS)
        places = [*none, *(Point(s, offset, MIDLINE) for s, offset in points)]
        self._check_session(session)
        shape = Measured(flat, tuple(places), tip=MIDLINE, session=session, name="the prediction")
        there = from_rest(self.experiment([shape]), self.array)
        for reason in there.lost.values():
            raise UnsettledShapeError(shape.name, reason)
        return self._predicted(there, len(points) or 1)

    def plan(self, targets: Any, **options: Any) -> Plan:
        """Return a plan of the calibrated arm, whose outcome tells how sure its tip is.

        Arguments are those of `plan`; the scene is the calibrated one.
        """
        planned = plan(self.arm, targets, self.scene, **options)
        predicted = self.predict(planned.tensions)
        measured = float(np.sqrt(np.trace(predicted.covariance[0])))
        return planned.converted(
            CalibratedPlan,
            tip_std=predicted.tip_std,
            measured_std=measured,
            evidence=self.evidence,
        )

    def next(self, candidates: Sequence[Any], session: str = "") -> tuple[Candidate, ...]:
        """Return sets of tensions, best first, by what measuring them tells of the unknowns.

        The markers are those of the session's first shape, or of the first; see Candidate.
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
        before, rows = np.diag(np.linalg.inv(M)), list[Candidate]()
        told_by = there.scaled(self.noise)
        for i, shape in enumerate(shapes):
            gain, shrink = 0.0, np.ones(len(before))
            if i in told_by:
                more = M + told_by[i][1].T @ told_by[i][1]
                gain = float(np.linalg.slogdet(more)[1] - np.linalg.slogdet(M)[1]) / 2
                shrink = np.sqrt(np.diag(np.linalg.inv(more)) / before)
            rows.append(Candidate(i, shape.tensions, gain, tuple(shrink.tolist())))
        return tuple(sorted(rows, key=lambda candidate: -candidate.gain))

    def leave_out(self, groups: Sequence[Any] | None = None) -> LeftOut:
        """Return how well shapes are predicted by fits without them.

        One by one, or all shapes with the same label of `groups` (one for each shape) together.
        """
        allowed = f"a label for each of {len(self.measured)} shapes"
        each = range(len(self.measured)) if groups is None else groups
        labels = list(kind("groups", each, Iterable, allowed))
        if len(labels) != len(self.measured):
            raise InputError("groups", len(labels), allowed)
        if len(set(labels)) < 2:
            raise InputError("groups", labels, "two labels or more: some shapes have to stay")
        whole, values, held = self.evaluation, list[tuple[float, ...]](), list[bool]()
        rows = dict[int, tuple[Residual, ...]]()
        for label in track("shapes left out", list(dict.fromkeys(labels))):
            kept = whole.only([i for i in whole.equilibria if labels[i] != label])
            refit = fit(kept, self.loss, self.absolute_std)
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
        """Return what is predicted less what was measured of other shapes of this arm."""
        shapes = checked_shapes(self.given_arm, measured)
        return tuple(from_rest(self.experiment(shapes), self.array).named())

    def _check_session(self, session: str) -> None:
        sessions = {shape.session for shape in self.measured}
        if session and session not in sessions:
            raise InputError("session", session, ", ".join(sorted(sessions - {""})) or "none")

    def _predicted(self, there: Evaluation, count: int) -> Prediction:
        """Return the prediction of the one shape of an evaluation, bands of its first places."""
        ((i, miss),) = there.residuals.items()
        shape = there.experiment.shapes[i]
        n = len(shape.places)
        J = (there.jacobians[i][: 3 * n] * self.parameters.range).reshape(n, 3, -1)
        places = miss[: 3 * n].reshape(n, 3) + shape.places
        sure = J @ self.information[1] @ J.transpose(0, 2, 1)
        error = self._model_error(shape.arc_lengths(self.arm))[:count]
        band = sure[:count] + error[:, None, None] ** 2 * np.eye(3)
        if self.is_uncertain:
            nothing = np.diag([np.inf] * 3)
            sure, band = np.broadcast_to(nothing, sure.shape), np.broadcast_to(nothing, band.shape)
            error = np.full(count, np.inf)
        # What a shape's markers are missed by has one cause.
        left = self.degrees_of_freedom / sum(shape.size for shape in self.explained)
        freedom = np.inf if self.uses_given_std else max(left * len(self.explained), 1.0)
        return Prediction(places[-1], sure[-1], places[:count], band, error, freedom)

    def _model_error(self, s: Array) -> Array:
        """Return the standard deviation of a coordinate at arc lengths s (N,) [m].

        By marker what fits without a shape miss of it, between markers in proportion; without
        markers the noise of the measurements.
        """
        shapes = {i: self.measured[i] for i in self.jacobians}
        at = np.concatenate([shape.arc_lengths(self.arm) for shape in shapes.values()])
        if not at.size:
            stds = [shape.place_std for shape in self.measured]
            return np.full(s.size, self.noise * np.mean(stds))
        missed = self._deleted_squares()
        rows = [missed[i][: shape.places.size].reshape(-1, 3) for i, shape in shapes.items()]
        squares = np.vstack(rows).mean(axis=1)
        nodes = np.unique(np.round(at, 9))
        by_node = [np.sqrt(np.mean(squares[np.isclose(at, node)])) for node in nodes]
        return np.asarray(np.interp(s, nodes, by_node))

    def _deleted_squares(self) -> dict[int, Array]:
        """Return squared residuals (size,) of each shape by a fit without it, to first order.

        (I - H_ii)^-1 r_i with H = J (J^T J)^-1 J^T by blocks of shapes: residuals of one shape have
        the same causes, which no single number's leverage tells. Priors are further rows of J.
        Source: Cook and Weisberg, "Residuals and Influence in Regression" (1982), 4.2.

        Combinations of the numbers of a shape that no other shape determines have no such residual.
        Their square is that of the noise.
        """
        J = self.all_jacobians
        inverse, missed = np.linalg.pinv(J.T @ J, hermitian=True), dict[int, Array]()
        scaled = self.evaluation.scaled()
        for i, J_i in self.jacobians.items():
            left, basis = np.linalg.eigh(np.eye(len(J_i)) - J_i @ inverse @ J_i.T)
            kept = left > _ALONE
            back = np.linalg.solve(self.evaluation.whitening[i], basis)
            deleted = back[:, kept] @ (basis[:, kept].T @ scaled[i][0] / left[kept])
            alone = np.square(self.noise * back[:, ~kept]).sum(axis=1)
            missed[i] = np.square(deleted) + alone
        return missed

    def save(self, path: str | Path) -> Path:
        """Write the calibration to a .json file, which `load_calibration` reads."""
        return write_named(path, ".json", to_json(record(CalibrationRecord, self)))

    def plot(self, ax: Any = None) -> Any:
        """Draw markers over settled arms, residuals as they were measured, and standard errors.

        Residuals alone in `ax`, if it is given. Returns a new Figure, or the axes.
        """
        from octoplan.planner.frontends.plots.results import plot_calibration

        return plot_calibration(self, ax=ax)
