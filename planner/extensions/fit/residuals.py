"""What settled shapes predict less what was measured of them, with derivatives by the unknowns.

What a sensor shows of a pose is a function in CasADi's symbols, differentiated by CasADi: the place
of a marker, or of a frame twice the vector part of the quaternion that is between it and the
measured one. How poses and lengths change with the unknowns is told by the equations' derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from operator import itemgetter
from typing import NamedTuple

import casadi as ca
import numpy as np

from octoplan.model import OctoplanError
from octoplan.model.equilibrium.linearised import Equilibrium, check_stretch
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.equilibrium.newton import CLOSE, Start, newton
from octoplan.model.equilibrium.sensitivities import ByNumbers, along
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, multiply, rotate
from octoplan.model.support.machine.functions import BatchFunction, cached
from octoplan.planner.extensions.fit.experiment import (
    LOOSER,
    Experiment,
    Reached,
    SessionEquations,
    tensions_by_lengths,
)

# How often the way to other values is halved for shapes that one step does not lead to.
_HALVINGS = 2


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError, remark: str = "") -> None:
        self.name, self.why, self.remark = name, why, remark
        super().__init__(f"{name} does not settle: {why}{'. ' * bool(remark)}{remark}")


class Residual(NamedTuple):
    """What is predicted less what was measured of one thing of a shape.

    `what` is a marker ("points[1]"), "tip", a frame or a tendon; `miss` in m, of frames the axis of
    the rotation between times twice the sine of half its angle: the rotation vector [rad] where
    that is small.
    """

    shape: str
    what: str
    miss: tuple[float, ...]

    @property
    def size(self) -> float:
        """The distance [m], or angle [rad]."""
        return float(np.linalg.norm(self.miss))

    @property
    def is_place(self) -> bool:
        """Whether it is a marker's or the tip's."""
        return self.what.startswith(("points", "tip"))


def mean_distance(residuals: Iterable[Residual]) -> float:
    """Return the mean distance of markers and tips from where they are predicted [m], or NaN."""
    sizes = [residual.size for residual in residuals if residual.is_place]
    return float(np.mean(sizes)) if sizes else float("nan")


@lru_cache(maxsize=1)
def _sensor_readings() -> ca.Function:
    """Return pose (7,), offset (3,), quaternion -> what is shown (3,), its derivatives (3, 10).

    By pose and offset. The quaternion is that of a measured frame, 0 of a marker.
    """
    pose, offset, seen = ca.SX.sym("pose", 7), ca.SX.sym("offset", 3), ca.SX.sym("seen", 4)
    place = pose[4:] + rotate(pose[:4], offset)
    between = multiply(pose[:4], conjugate(seen))
    turned = 2 * ca.if_else(between[0] < 0, -between[1:], between[1:])
    shown = ca.if_else(ca.sumsqr(seen) > 0, turned, place)
    J = ca.jacobian(shown, ca.vertcat(pose, offset))
    return ca.Function("shown", [pose, offset, seen], [shown, ca.densify(J.T)])


def from_rest(experiment: Experiment, values: Array) -> Evaluation:
    """Return all shapes at values (K,) as they are reached from rest.

    InputError where no such arm can be; shapes that have no equilibrium are `lost`.
    """
    at = experiment.at(values)
    reached = {i: at[of].from_rest(i) for i, of in enumerate(experiment.session)}
    return Evaluation.of(experiment, values, at, reached)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Shapes at given values (K,) of the unknowns, and what sensors show of them.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    at : dict of SessionEquations
        Of each session.
    equilibria : dict of Equilibrium
        By the number of their shape, in order; without those left out or lost.
    lost : dict of OctoplanError
        Why others have none.
    """

    experiment: Experiment
    values: Array
    at: Mapping[str, SessionEquations]
    equilibria: Mapping[int, Equilibrium]
    lost: Mapping[int, OctoplanError]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        values: Array,
        at: Mapping[str, SessionEquations],
        reached: Mapping[int, Reached],
    ) -> Evaluation:
        """Return the shapes that were reached, in order, and those that were not."""
        rows = sorted(reached.items(), key=itemgetter(0))
        equilibria = {i: end for i, end in rows if isinstance(end, Equilibrium)}
        lost = {i: end for i, end in rows if isinstance(end, OctoplanError)}
        return cls(experiment, values, at, equilibria, lost)

    def relinearised(self) -> Evaluation:
        """Return the evaluation with derivatives at the shapes' own states."""
        points = {i: point.relinearised() for i, point in self.equilibria.items()}
        return Evaluation(self.experiment, self.values, self.at, points, self.lost)

    def only(self, kept: Iterable[int]) -> Evaluation:
        """Return the evaluation with all but some shapes left out."""
        left = {i: self.equilibria[i] for i in sorted(kept) if i in self.equilibria}
        return Evaluation(self.experiment, self.values, self.at, left, {})

    def near(self, values: Array, experiment: Experiment | None = None) -> Evaluation:
        """Return the shapes at other values, on the same branches if these can be followed.

        On the meshes of this experiment or of another one of the same shapes. A shape that cannot
        be followed is taken as the arm reaches it from rest; one that does not settle is `lost`.
        """
        there = self._followed(values, experiment or self.experiment, _HALVINGS)
        rest = {i: there.equations(i).from_rest(i) for i in there.lost}
        return Evaluation.of(there.experiment, values, there.at, {**there.equilibria, **rest})

    def _followed(self, values: Array, experiment: Experiment, halvings: int) -> Evaluation:
        """Return the shapes on the same branches; the others are `lost`.

        The way to other values is halved, at most so often, for shapes that one step loses.
        """
        there = self._predicted_shapes(values, experiment)
        if there.lost and halvings and experiment is self.experiment:
            middle = (self.values + values) / 2
            half = self.only(there.lost)._followed(middle, experiment, halvings - 1)
            rest = half._followed(values, experiment, halvings - 1)
            reached = dict[int, Reached](there.lost)
            for part in (half.lost, rest.lost, there.equilibria, rest.equilibria):
                reached |= part
            there = Evaluation.of(experiment, values, there.at, reached)
        return there

    def _predicted_shapes(self, values: Array, experiment: Experiment) -> Evaluation:
        """Return the shapes where Newton's method leads from where derivatives say that they are.

        Where the mesh is another, from the strains on that.
        """
        at, change, reached = experiment.at(values), values - self.values, dict[int, Reached]()
        for i, before in self.equilibria.items():
            shape, to = self.experiment.shapes[i], at[self.experiment.session[i]]
            states, tensions = before.states, before.tensions
            if change.any():
                by = self.by_numbers[i]
                states = states + by.states @ change
                tensions = np.maximum(tensions + by.tensions @ change, 0.0)
            T = tensions if shape.by_length else to.tensions(shape)
            of, near = before.system.layout, None
            if to.system.layout is not of:
                states = Collocation(to.system).carried(T[None], [before])[0]
            elif np.abs(states - before.states)[of.nodes[:, :4]].max() < CLOSE:
                near = before
            (end,) = newton(to.system, [Start(T, 1.0, states, near, LOOSER)])
            reached[i] = to.held(shape, end or OctoplanError("it jumps"))
            if isinstance(end, Equilibrium):
                try:
                    check_stretch(end)
                except OctoplanError as reason:
                    reached[i] = reason
        return Evaluation.of(experiment, values, at, reached)

    def equations(self, i: int) -> SessionEquations:
        """Return the equations of a shape."""
        return self.at[self.experiment.session[i]]

    @cached_property
    def by_numbers(self) -> dict[int, ByNumbers]:
        """Derivatives of the equilibria by the unknowns."""
        shapes = self.experiment.shapes
        return {
            i: self.equations(i).differentiated(shapes[i], here)
            for i, here in self.equilibria.items()
        }

    @property
    def residuals(self) -> dict[int, Array]:
        """Predictions less measurements (size,), [m] and [rad], of each shape by number."""
        result = dict[int, Array]()
        for i, here in self.equilibria.items():
            shape, rest = self.experiment.shapes[i], self.equations(i).numbers.rest
            runs = shape.run_values(partial(getattr, here, "lengths"), rest)
            shown = np.concatenate([self._sensor_readings[i][0].ravel(), *runs])
            result[i] = shown - shape.numbers
        return result

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Their derivatives by the unknowns (size, K)."""
        result = dict[int, Array]()
        for i, by in self.by_numbers.items():
            at, rows = self.equations(i), self.experiment.rows[i]
            poses, derivatives = by.states[at.places[rows]], at.derivatives
            # Of what is looked at, which need not move along with its node.
            slip = derivatives.s[rows] - derivatives.nodes[at.nodes[rows]]
            if slip.any():
                poses = poses + along(by.point, at.nodes[rows])[:, :, None] * slip[:, None, :]
            moved = np.concatenate([poses, derivatives.offsets[rows]], axis=1)
            result[i] = self._residual_derivatives(
                i, moved, partial(getattr, by, "lengths"), derivatives.rest
            )
        return result

    @cached_property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which they are of unit variance, as is known.

        Noise of what drives a shape, its tensions or its lengths, is carried to the residuals to
        first order: the effective variance. Source: Orear, American Journal of Physics 50 (1982).
        """
        result = dict[int, Array]()
        for i, here in self.equilibria.items():
            shape, at = self.experiment.shapes[i], self.equations(i)
            if not shape.by_length and not shape.tension_std:
                result[i] = np.diag(1 / shape.stds)
                continue
            inputs = shape.tension_std * np.diag(at.numbers.scale)
            if shape.by_length:
                inputs = shape.tendon_std * tensions_by_lengths(here)
            poses = here.by_tensions[at.places[self.experiment.rows[i]]]
            moved = np.concatenate([poses, np.zeros((len(poses), 3, len(inputs)))], axis=1)
            J = (
                self._residual_derivatives(i, moved, partial(getattr, here, "length_tension"), 0.0)
                @ inputs
            )
            variance = np.diag(np.square(shape.stds)) + J @ J.T
            result[i] = np.linalg.inv(np.linalg.cholesky(variance))
        return result

    def scaled(self, noise: float = 1.0) -> dict[int, tuple[Array, Array]]:
        """Return residuals (size,) of each shape over the noise, whitened, and their derivatives.

        By unknowns counted from 0 to 1 (size, K).
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
            rows = [*miss[: 3 * len(names)].reshape(-1, 3), *miss[3 * len(names) :, None]]
            names += [f"{run}[{j}]" for run in shape.runs for j in range(len(getattr(shape, run)))]
            for what, row in zip(names, rows, strict=True):
                yield Residual(shape.name, what, tuple(row.tolist()))

    def _residual_derivatives(
        self, i: int, moved: Array, lengths: Callable[[], Array], rest: Array | float
    ) -> Array:
        """Return how residuals of a shape change (size, k).

        With poses and offsets (M, 10, k) of its sensors, and lengths and those at rest of its
        tendons (n_tendons, k).
        """
        runs = self.experiment.shapes[i].run_values(lengths, rest)
        return np.vstack([(self._sensor_readings[i][1] @ moved).reshape(-1, moved.shape[2]), *runs])

    @cached_property
    def _sensor_readings(self) -> dict[int, tuple[Array, Array]]:
        """What sensors of each shape show (M, 3), and its derivatives (M, 3, 10)."""
        show, result = cached(BatchFunction, _sensor_readings()), dict[int, tuple[Array, Array]]()
        for i, here in self.equilibria.items():
            at, rows = self.equations(i), self.experiment.rows[i]
            poses, offsets = here.states[at.places[rows]], at.numbers.offsets[rows]
            shown, J = show(poses, offsets, self.experiment.seen[rows])
            result[i] = shown, J.reshape(-1, 3, 10)
        return result
