"""What a calibration predicts: shapes under other tensions, shapes left out, what to measure next.

Which shapes to measure next (D-optimal): what one adds to the logarithm of the determinant of the
information matrix,

    1/2 log det(I + J M^-1 J^T),    J of its residuals over the noise, M the information so far.

Source: Atkinson, Donev, Tobias, "Optimum Experimental Designs, with SAS" (2007), chapter 11.
The bounds count as a uniform distribution, so that M is regular.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy

from model import InputError
from model.paths import Array
from model.progress import told
from planner.fit.fitted import Fitted
from planner.fit.least_squares import fit
from planner.fit.measured import Measured, Point
from planner.fit.residuals import Evaluation, Residual, UnsettledShapeError, mean_distance

_ORIGIN = (0.0, 0.0, 0.0)
# The variance of a uniform distribution from 0 to 1, inverted.
_UNIFORM = 12.0
# Singular values of what a shape leaves to others, below which it alone tells an unknown.
_ALONE = 1e-3


@dataclass(frozen=True, eq=False)
class Prediction:
    """The tip and points of a shape, with bands for what would be measured there.

    Attributes
    ----------
    tip : (3,)
        [m].
    std : (3, 3)
        Covariance matrix of the tip by the standard errors of the unknowns [m2]: how sure the
        calibrated arm's tip is, if the model is right.
    places : (P, 3)
        Of the points [m]; the tip unless points were given.
    covariance : (P, 3, 3)
        Of what would be measured: that of the unknowns, carried to the points, and the model error.
    model_error : (P,)
        Standard deviation of a coordinate by which fits without a shape miss it at such an arc
        length [m].
    freedom : float
        Degrees of freedom of the model error: as many as shapes, less what the unknowns take of
        them, as what a shape's markers are missed by has one cause; inf where standard deviations
        hold as given.
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
        return np.asarray(scipy.special.stdtrit(self.freedom, (1 + level) / 2) * spread)

    def holds(self, places: Any, level: float = 0.95) -> Array:
        """Return whether measured places (P, 3) [m] lie in the points' ellipsoids (P,)."""
        off = (np.asarray(places, dtype=float) - self.places)[:, :, None]
        size = (off * np.linalg.solve(self.covariance, off)).sum(axis=(1, 2))
        return np.asarray(size <= 3 * scipy.special.fdtri(3, self.freedom, level))


def predict(
    of: Fitted, tensions: Any, points: Sequence[tuple[float, Any]], session: str
) -> Prediction:
    """See Calibration.predict."""
    flat = tuple(of.given_arm.flat(tensions).tolist())
    markers = tuple(Point(s, offset, _ORIGIN) for s, offset in points)
    shape = Measured(flat, markers, tip=_ORIGIN, session=session, name="the shape asked for")
    there = of.experiment([shape]).from_rest(of.array)
    for reason in there.lost.values():
        raise UnsettledShapeError(shape.name, reason)
    return predicted(of, there, slice(0, len(markers) or 1))


def predicted(of: Fitted, there: Evaluation, which: slice) -> Prediction:
    """Return the prediction of the one shape of an evaluation, bands of `which` of its places."""
    ((i, miss),) = there.residuals.items()
    shape = there.experiment.shapes[i]
    n = len(shape.places)
    J = (there.jacobians[i][: 3 * n] * of.parameters.range).reshape(n, 3, -1)
    places = miss[: 3 * n].reshape(n, 3) + shape.places
    known = np.where(np.isfinite(of.information.covariance), of.information.covariance, 0.0)
    sure = J @ known @ J.transpose(0, 2, 1)
    error = model_error(of, _arc_lengths(of, shape)[:n])[which]
    covariance = sure[which] + error[:, None, None] ** 2 * np.eye(3)
    # What a shape's markers are missed by has one cause.
    left = of.degrees_of_freedom / sum(own.size for own in of.explained)
    freedom = np.inf if of.weights.absolute else max(min(left, 1.0) * len(of.explained), 1.0)
    return Prediction(places[-1], sure[-1], places[which], covariance, error, freedom)


def _arc_lengths(of: Fitted, shape: Measured) -> Array:
    """Return where the places of a shape are along the arm (n,) [m]."""
    tip = [of.arm.length] * (shape.tip is not None)
    return np.array([*(point.s for _, point in shape.seen), *tip])


def model_error(of: Fitted, s: Array) -> Array:
    """Return the standard deviation of a coordinate at arc lengths s (N,) [m].

    By marker what fits without a shape miss of it, between markers in proportion; without markers
    the noise of the measurements.
    """
    missed = deleted_residuals(of)
    shapes = {i: of.measured[i] for i in missed}
    at = np.concatenate([_arc_lengths(of, shape) for shape in shapes.values()])
    if not at.size:
        return np.full(s.size, of.noise * float(np.mean([shape.std for shape in of.measured])))
    rows = [missed[i][: 3 * len(shape.places)].reshape(-1, 3) for i, shape in shapes.items()]
    squares = np.square(np.vstack(rows)).mean(axis=1)
    nodes = np.unique(np.round(at, 9))
    by_node = [np.sqrt(np.mean(squares[np.isclose(at, node)])) for node in nodes]
    return np.asarray(np.interp(s, nodes, by_node))


def deleted_residuals(of: Fitted) -> dict[int, Array]:
    """Return the residuals (size,) of each shape by a fit without it, to first order.

    (I - H_ii)^-1 r_i with H = J (J^T J)^-1 J^T by blocks of shapes: residuals of one shape have the
    same causes, which no single number's leverage tells. Source: Cook and Weisberg, "Residuals and
    Influence in Regression" (1982), 4.2.
    """
    J = np.vstack(list(of.jacobians.values()))
    inverse, missed = np.linalg.pinv(J.T @ J, hermitian=True), dict[int, Array]()
    for i, own in of.jacobians.items():
        kept, whitening = np.eye(len(own)) - own @ inverse @ own.T, of.evaluation.whitening[i]
        deleted = np.linalg.pinv(kept, _ALONE) @ (whitening @ of.evaluation.residuals[i])
        missed[i] = np.asarray(np.linalg.solve(whitening, deleted))
    return missed


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


def leave_out(of: Fitted, groups: Sequence[Hashable] | None) -> LeftOut:
    """See Calibration.leave_out."""
    labels = list(range(len(of.measured))) if groups is None else list(groups)
    if len(labels) != len(of.measured):
        raise InputError("groups", len(labels), f"a label for each of {len(of.measured)} shapes")
    if len(set(labels)) < 2:
        raise InputError("groups", labels, "two labels or more: some shapes have to stay")
    whole, values, held = of.evaluation, list[tuple[float, ...]](), list[bool]()
    rows = dict[int, tuple[Residual, ...]]()
    for label in told("shapes left out", list(dict.fromkeys(labels))):
        found = fit(whole.only([i for i in whole.equilibria if labels[i] != label]), of.weights)
        at = found.evaluation.values
        values.append(tuple(at.tolist()))
        without = replace(of, values=values[-1], noise=found.noise, known=found.evaluation)
        for i in (i for i in whole.equilibria if labels[i] == label):
            there = whole.only([i]).near(at)
            if there.lost:
                there = there.experiment.from_rest(at).only([i])
            if there.equilibria:
                rows[i] = there.named()
                places = of.measured[i].places
                bands = predicted(without, there, slice(0, len(places)))
                held += bands.holds(places).tolist()
    return LeftOut(tuple(row for i in sorted(rows) for row in rows[i]), tuple(values), tuple(held))


class Candidate(NamedTuple):
    """A shape that could be measured.

    Its `place` among the candidates, tensions [N], what it tells [nats], and by what factor the
    standard errors (K,) shrink; a shape that does not settle tells nothing.
    """

    place: int
    tensions: tuple[float, ...]
    gain: float
    shrink: tuple[float, ...]


def ranked(of: Fitted, candidates: Sequence[Any], session: str) -> tuple[Candidate, ...]:
    """See Calibration.next."""
    given = list(candidates)
    if not given:
        raise InputError("candidates", candidates, "at least one set of tensions")
    sessions = {shape.session for shape in of.measured}
    if session and session not in sessions:
        raise InputError("session", session, ", ".join(sorted(sessions - {""})) or "none")
    like = next((m for m in of.measured if m.session == session), of.measured[0])
    flat = [of.given_arm.flat(T, f"candidates[{i}]").tolist() for i, T in enumerate(given)]
    shapes = [
        replace(like, tensions=tuple(T), session=session, name=f"candidates[{i}]")
        for i, T in enumerate(flat)
    ]
    there = of.experiment(shapes).from_rest(of.array)
    J = np.vstack(list(of.jacobians.values()))
    M = J.T @ J + _UNIFORM * np.eye(J.shape[1])
    before, rows = np.diag(np.linalg.inv(M)), list[Candidate]()
    for i, T in enumerate(flat):
        gain, shrink = 0.0, np.ones(len(before))
        if i not in there.lost:
            own = there.whitening[i] @ there.jacobians[i] * of.parameters.range / of.noise
            more = M + own.T @ own
            gain = float(np.linalg.slogdet(more)[1] - np.linalg.slogdet(M)[1]) / 2
            shrink = np.sqrt(np.diag(np.linalg.inv(more)) / before)
        rows.append(Candidate(i, tuple(T), gain, tuple(shrink.tolist())))
    return tuple(sorted(rows, key=lambda own: -own.gain))
