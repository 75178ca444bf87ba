"""Where a calibrated arm's points are under other tensions, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from model.paths import Array
from planner.calibrate.experiment import Evaluation
from planner.calibrate.fitted import Fitted
from planner.calibrate.measured import Measured

_ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Places of points, with bands for what would be measured there.

    Attributes
    ----------
    places : (P, 3)
        [m].
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

    places: Array
    covariance: Array
    model_error: Array
    freedom: float

    def band(self, level: float = 0.95) -> Array:
        """Return the half widths of the band by coordinate (P, 3) [m]."""
        spread = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return np.asarray(scipy.special.stdtrit(self.freedom, (1 + level) / 2) * spread)

    def holds(self, places: Any, level: float = 0.95) -> Array:
        """Return whether measured places (P, 3) [m] lie in the points' ellipsoids (P,)."""
        off = np.asarray(places, dtype=float) - self.places
        size = np.einsum(
            "pi,pi->p", off, np.linalg.solve(self.covariance, off[:, :, None])[:, :, 0]
        )
        return np.asarray(size <= 3 * scipy.special.fdtri(3, self.freedom, level))


def predict(
    of: Fitted, tensions: Any, points: Sequence[tuple[float, Any]], session: str
) -> Prediction:
    """See Calibration.predict."""
    wanted = list(points) or [(of.arm.length, _ORIGIN)]
    shape = Measured(tensions, [(s, o, _ORIGIN) for s, o in wanted], session=session)
    flat = tuple(of.given_arm.flat(tensions).tolist())
    asked = Measured(flat, shape.points, session=session, name="the shape asked for")
    return predicted(of, of.experiment([asked]).at(of.array))


def predicted(of: Fitted, there: Evaluation) -> Prediction:
    """Return the prediction of the one shape of an evaluation, of all points that it has seen."""
    (shape,) = there.experiment.shapes
    n = 3 * len(shape.seen)
    J = (there.jacobian * shape.stds[:, None])[:n] * of.parameters.range
    J = J.reshape(-1, 3, J.shape[1])
    own = np.array([point.s for _, point in shape.seen])
    error = model_error(of, own)
    known = np.where(np.isfinite(of.information.covariance), of.information.covariance, 0.0)
    covariance = J @ known @ J.transpose(0, 2, 1) + error[:, None, None] ** 2 * np.eye(3)
    places = there.by_shape[0][:n].reshape(-1, 3) + shape.places
    return Prediction(places, covariance, error, _freedom(of))


def _freedom(of: Fitted) -> float:
    if of.weights.absolute:
        return np.inf
    left = of.degrees_of_freedom / sum(shape.size for shape in of.measured)
    return max(min(left, 1.0) * len(of.measured), 1.0)


def model_error(of: Fitted, s: Array) -> Array:
    """Return the standard deviation of a coordinate at arc lengths s (N,) [m].

    By marker what fits without a shape miss of it, between markers in proportion; without markers
    the noise of the measurements.
    """
    at, squares = list[float](), list[Array]()
    for shape, miss in zip(of.measured, deleted_residuals(of), strict=True):
        places = [point.s for _, point in shape.seen] + [of.arm.length] * (shape.tip is not None)
        at += places
        squares += list(np.square(miss[: 3 * len(places)]).reshape(-1, 3).mean(axis=1))
    if not at:
        return np.full(s.size, of.noise * float(np.mean([shape.std for shape in of.measured])))
    nodes = np.unique(np.round(at, 9))
    by_node = [np.sqrt(np.mean(np.array(squares)[np.isclose(at, node)])) for node in nodes]
    return np.asarray(np.interp(s, nodes, by_node))


def deleted_residuals(of: Fitted) -> list[Array]:
    """Return the residuals (size,) of each shape by a fit without it, to first order.

    (I - H_ii)^-1 r_i with H = J (J^T J)^-1 J^T by blocks of shapes: residuals of one shape have the
    same causes, which no single number's leverage tells. Source: Cook and Weisberg, "Residuals and
    Influence in Regression" (1982), 4.2.
    """
    J = of.scaled_jacobian
    inverse, found, first = np.linalg.pinv(J.T @ J, hermitian=True), list[Array](), 0
    for shape, miss in zip(of.measured, of.evaluation.by_shape, strict=True):
        own = J[first : first + shape.size]
        kept = np.eye(shape.size) - own @ inverse @ own.T
        found.append(shape.stds * (np.linalg.pinv(kept, 1e-3) @ (miss / shape.stds)))
        first += shape.size
    return found
