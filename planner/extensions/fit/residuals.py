"""Residuals: predictions of settled shapes minus measurements, and their derivatives.

CasADi functions map a pose to a sensor reading: the place of a marker, or for a frame twice the
vector part of the quaternion from the measured frame to the predicted one. The sensitivities of the
equilibrium give the derivatives of poses and lengths with respect to the unknowns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import NamedTuple

import casadi as ca
import numpy as np

from octoplan.model import OctoplanError
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium, check_stretch
from octoplan.model.equilibrium.newton import CHORD_RADIUS, Start, newton
from octoplan.model.equilibrium.sensitivities import ParameterSensitivities, along
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, multiply, rotate
from octoplan.model.support.machine.functions import BatchFunction, cached
from octoplan.planner.extensions.fit.drives import Drive
from octoplan.planner.extensions.fit.experiment import (
    LOOSER,
    Experiment,
    Reached,
    SessionEquations,
)

# Largest number of bisections of the step to other values, for shapes that one step loses.
_HALVINGS = 2
# Mean error of a shape's markers, over the arm's length, above which the shape is not reached.
_UNREACHED = 0.1


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError, remark: str = "") -> None:
        self.name = name
        self.why = why
        self.remark = remark
        super().__init__(f"{name} does not settle: {why}{'. ' * bool(remark)}{remark}")


class Residual(NamedTuple):
    """Prediction minus measurement of one quantity of a shape.

    Attributes
    ----------
    shape : str
        Name of the shape.
    what : str
        Measured quantity: a marker ("points[1]"), "tip", a frame or a tendon.
    miss : tuple of float
        Prediction minus measurement [m]; NaN for coordinates that were not measured. For frames:
        the rotation axis times twice the sine of half the rotation angle, close to the rotation
        vector [rad] for small angles.
    """

    shape: str
    what: str
    miss: tuple[float, ...]

    @property
    def size(self) -> float:
        """Norm of the measured components: distance [m] or angle [rad]."""
        return float(np.sqrt(np.nansum(np.square(self.miss))))

    @property
    def is_place(self) -> bool:
        """Whether the residual belongs to a marker or the tip."""
        return self.what.startswith(("points", "tip"))


def mean_distance(residuals: Iterable[Residual]) -> float:
    """Return the mean distance between measured and predicted markers and tips [m], or NaN."""
    sizes = [residual.size for residual in residuals if residual.is_place]
    return float(np.mean(sizes)) if sizes else float("nan")


def unreached(at: Evaluation) -> tuple[str, ...]:
    """Return the names of shapes that a fit does not reach.

    The mean error of their markers, tendon lengths or strokes is above a tenth of the arm's length.
    """
    far = _UNREACHED * at.experiment.parameters.given.arm.length
    sizes = dict[tuple[str, str], list[float]]()
    for residual in at.named():
        if not residual.what.startswith("frames"):
            kind = "places" if residual.is_place else residual.what.partition("[")[0]
            sizes.setdefault((residual.shape, kind), []).append(residual.size)
    rows = [name for (name, _), of_kind in sizes.items() if np.mean(of_kind) > far]
    return tuple(dict.fromkeys(rows))


@lru_cache(maxsize=1)
def sensor_readings() -> ca.Function:
    """Return the function pose (7,), offset (3,), quaternion -> reading (3,), derivatives (3, 10).

    The quaternion is the measured frame, or 0 for a marker. The derivatives are with respect to
    pose and offset.
    """
    pose = ca.SX.sym("pose", 7)
    offset = ca.SX.sym("offset", 3)
    measured = ca.SX.sym("measured", 4)
    place = pose[4:] + rotate(pose[:4], offset)
    between = multiply(pose[:4], conjugate(measured))
    rotation = 2 * ca.if_else(between[0] < 0, -between[1:], between[1:])
    reading = ca.if_else(ca.sumsqr(measured) > 0, rotation, place)
    J = ca.jacobian(reading, ca.vertcat(pose, offset))
    return ca.Function("reading", [pose, offset, measured], [reading, ca.densify(J.T)])


def from_rest(experiment: Experiment, values: Array) -> Evaluation:
    """Settle all shapes from rest at values (K,); InputError for values of an invalid arm.

    Shapes without equilibrium are in `failed`.
    """
    at = experiment.at(values)
    reached = {i: at[of].from_rest(i) for i, of in enumerate(experiment.session)}
    return Evaluation.of(experiment, values, at, reached)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Settled shapes at values (K,) of the unknowns, with sensor readings and derivatives.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    at : dict of SessionEquations
        Equations of each session.
    equilibria : dict of Equilibrium
        Equilibria by index of the shape, in order, without shapes that are left out or failed.
    failed : dict of OctoplanError
        Errors of the shapes that did not settle, by index.
    """

    experiment: Experiment
    values: Array
    at: Mapping[str, SessionEquations]
    equilibria: Mapping[int, Equilibrium]
    failed: Mapping[int, OctoplanError]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        values: Array,
        at: Mapping[str, SessionEquations],
        reached: Mapping[int, Reached],
    ) -> Evaluation:
        """Return the evaluation of equilibria and errors, by index of the shape."""
        rows = sorted(reached.items(), key=itemgetter(0))
        equilibria = {i: end for i, end in rows if isinstance(end, Equilibrium)}
        failed = {i: end for i, end in rows if isinstance(end, OctoplanError)}
        return cls(experiment, values, at, equilibria, failed)

    def relinearised(self) -> Evaluation:
        """Return the evaluation with derivatives at the exact states of the equilibria."""
        points = {i: point.relinearised() for i, point in self.equilibria.items()}
        return Evaluation(self.experiment, self.values, self.at, points, self.failed)

    def only(self, kept: Iterable[int]) -> Evaluation:
        """Return the evaluation of some of the shapes."""
        equilibria = {i: self.equilibria[i] for i in sorted(kept) if i in self.equilibria}
        return Evaluation(self.experiment, self.values, self.at, equilibria, {})

    def near(self, values: Array, experiment: Experiment | None = None) -> Evaluation:
        """Continue the shapes to other values, on the same branches if possible.

        The meshes are the ones of this experiment, or of another experiment with the same shapes.
        A shape that cannot be continued is settled from rest; if that fails, it is in `failed`.
        """
        there = self._continued(values, experiment or self.experiment, _HALVINGS)
        rest = {i: there.equations(i).from_rest(i) for i in there.failed}
        return Evaluation.of(there.experiment, values, there.at, {**there.equilibria, **rest})

    def _continued(self, values: Array, experiment: Experiment, halvings: int) -> Evaluation:
        """Continue the shapes on the same branches; the others are in `failed`.

        Bisect the step to other values up to `halvings` times for shapes that one step loses.
        """
        there = self._newton_step(values, experiment)
        if there.failed and halvings and experiment is self.experiment:
            middle = (self.values + values) / 2
            half = self.only(there.failed)._continued(middle, experiment, halvings - 1)
            rest = half._continued(values, experiment, halvings - 1)
            reached = dict[int, Reached](there.failed)
            for part in (half.failed, rest.failed, there.equilibria, rest.equilibria):
                reached |= part
            there = Evaluation.of(experiment, values, there.at, reached)
        return there

    def _newton_step(self, values: Array, experiment: Experiment) -> Evaluation:
        """Predict the shapes at other values to first order, and correct by Newton's method.

        If the mesh differs, the correction starts from the strains interpolated to the new mesh.
        """
        at = experiment.at(values)
        change = values - self.values
        reached = dict[int, Reached]()
        for i, before in self.equilibria.items():
            shape = self.experiment.shapes[i]
            equations = at[self.experiment.session[i]]
            states = before.states
            tensions = before.tensions
            if change.any():
                by = self.parameter_sensitivities[i]
                states = states + by.states @ change
                tensions = np.maximum(tensions + by.tensions @ change, 0.0)
            drive = equations.drive(shape)
            T = np.where(drive.held, tensions, drive.tensions)
            layout = before.system.layout
            near = None
            if equations.system.layout is not layout:
                states = CollocationMap(equations.system).transfer_states(T[None], [before])[0]
            elif np.abs(states - before.states)[layout.nodes[:, :4]].max() < CHORD_RADIUS:
                near = before
            (end,) = newton(equations.system, [Start(T, 1.0, states, near, LOOSER)])
            reached[i] = equations.enforce_lengths(shape, end or OctoplanError("it jumps"))
            if isinstance(end, Equilibrium):
                try:
                    check_stretch(end)
                except OctoplanError as reason:
                    reached[i] = reason
        return Evaluation.of(experiment, values, at, reached)

    def equations(self, i: int) -> SessionEquations:
        """Return the equations of a shape."""
        return self.at[self.experiment.session[i]]

    def drive(self, i: int) -> Drive:
        """Return the tendons of a shape."""
        return self.equations(i).drive(self.experiment.shapes[i])

    @cached_property
    def parameter_sensitivities(self) -> dict[int, ParameterSensitivities]:
        """Derivatives of the equilibria with respect to the unknowns, by index of the shape."""
        return {
            i: self.drive(i).sensitivities(here, self.equations(i).derivatives)
            for i, here in self.equilibria.items()
        }

    @property
    def residuals(self) -> dict[int, Array]:
        """Predictions minus measurements (size,), [m] and [rad], by index of the shape."""
        result = dict[int, Array]()
        for i, here in self.equilibria.items():
            shape = self.experiment.shapes[i]
            sensors = self._sensor_readings[i][0][shape.is_measured]
            result[i] = np.concatenate([sensors, self.drive(i).readings(here)]) - shape.data
        return result

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Derivatives of the residuals with respect to the unknowns (size, K)."""
        result = dict[int, Array]()
        for i, by in self.parameter_sensitivities.items():
            derivatives = self.equations(i).derivatives
            readings = self.drive(i).reading_changes(self.equilibria[i], by, derivatives)
            result[i] = self._residual_changes(i, self._moved_sensors(i), readings)
        return result

    def predicted_places(self, i: int) -> Array:
        """Return the predicted places of the markers and the tip of a shape (n, 3) [m]."""
        count = len(self.experiment.shapes[i].markers)
        return np.asarray(self._sensor_readings[i][0][:count])

    def place_jacobian(self, i: int) -> Array:
        """Return the derivatives of `predicted_places` with respect to the unknowns (n, 3, K)."""
        count = len(self.experiment.shapes[i].markers)
        return np.asarray((self._sensor_readings[i][1] @ self._moved_sensors(i))[:count])

    def _moved_sensors(self, i: int) -> Array:
        """Return the changes of a shape's poses and offsets by the unknowns (M, 10, K)."""
        by = self.parameter_sensitivities[i]
        at = self.equations(i)
        rows = self.experiment.rows[i]
        derivatives = at.derivatives
        poses = by.states[at.pose_indices[rows]]
        # A sensor whose arc length changes moves relative to its node.
        slip = derivatives.s[rows] - derivatives.nodes[at.nodes[rows]]
        if slip.any():
            poses = poses + along(by.point, at.nodes[rows])[:, :, None] * slip[:, None, :]
        return np.concatenate([poses, derivatives.offsets[rows]], axis=1)

    @cached_property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) that scale the residuals to unit variance at noise 1.

        The noise of the inputs of a shape, tensions or lengths, is propagated to the residuals to
        first order (effective variance). Source: Orear, American Journal of Physics 50 (1982).
        """
        result = dict[int, Array]()
        for i, here in self.equilibria.items():
            shape = self.experiment.shapes[i]
            at = self.equations(i)
            if not shape.by_length and not shape.tension_std:
                result[i] = np.diag(1 / shape.stds)
                continue
            drive = self.drive(i)
            inputs = drive.input_tensions(here)
            poses = here.by_tensions[at.pose_indices[self.experiment.rows[i]]]
            moved = np.concatenate([poses, np.zeros((len(poses), 3, len(inputs)))], axis=1)
            readings = drive.reading_changes(here, None, None)
            J = self._residual_changes(i, moved, readings) @ inputs
            variance = np.diag(np.square(shape.stds)) + J @ J.T
            result[i] = np.linalg.inv(np.linalg.cholesky(variance))
        return result

    def scaled(self, noise: float = 1.0) -> dict[int, tuple[Array, Array]]:
        """Return whitened residuals (size,) over the noise, and their derivatives, by shape.

        The derivatives (size, K) are with respect to unknowns in [0, 1].
        """
        span = self.experiment.parameters.range
        return {
            i: (W @ self.residuals[i] / noise, W @ self.jacobians[i] * span / noise)
            for i, W in self.whitening.items()
        }

    def named(self) -> Iterator[Residual]:
        """Yield all residuals, shape by shape."""
        for i, miss in self.residuals.items():
            shape = self.experiment.shapes[i]
            names = [sensor.what for sensor in shape.sensors]
            is_measured = shape.is_measured
            sensors = np.full(is_measured.shape, np.nan)
            count = np.count_nonzero(is_measured)
            sensors[is_measured] = miss[:count]
            rows = [*sensors, *miss[count:, None]]
            names += [f"{kind}[{j}]" for kind, j in shape.tendon_residuals]
            for what, row in zip(names, rows, strict=True):
                yield Residual(shape.name, what, tuple(row.tolist()))

    def _residual_changes(self, i: int, moved: Array, readings: Array) -> Array:
        """Return the changes of a shape's residuals (size, k).

        The arguments are the changes of its sensors' poses and offsets (M, 10, k), and of the
        readings of encoders.
        """
        is_measured = self.experiment.shapes[i].is_measured
        sensors = (self._sensor_readings[i][1] @ moved)[is_measured]
        return np.vstack([sensors, readings]) if len(readings) else sensors

    @cached_property
    def _sensor_readings(self) -> dict[int, tuple[Array, Array]]:
        """Readings of each shape's sensors (M, 3), and their derivatives (M, 3, 10)."""
        function = cached(BatchFunction, sensor_readings())
        result = dict[int, tuple[Array, Array]]()
        for i, here in self.equilibria.items():
            at = self.equations(i)
            rows = self.experiment.rows[i]
            poses = here.states[at.pose_indices[rows]]
            offsets = at.parameters.offsets[rows]
            readings, J = function(poses, offsets, self.experiment.measured_rotations[rows])
            result[i] = readings, J.reshape(-1, 3, 10)
        return result
