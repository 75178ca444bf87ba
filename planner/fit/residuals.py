"""What settled shapes predict less what was measured of them, with derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from model import OctoplanError
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, Collocation, newton
from model.equilibrium.sensitivities import ByNumbers, along, displaced
from model.paths import Array
from model.rotations import matrices
from planner.fit.measured import FRAME, Measured
from planner.fit.sessions import Equations, Index, Reached, Session, tensions_by_lengths
from planner.fit.unknowns import Parameters

# How often the way to other values is halved for shapes that one step does not lead to.
_HALVINGS = 2
# How many times larger than elsewhere the last steps of Newton's method are.
_LOOSER = 1e3


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError) -> None:
        self.name, self.why = name, why
        super().__init__(f"{name} does not settle: {why}")


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


class Experiment:
    """Measured shapes of one arm, with the unknowns of both, on meshes of a refinement."""

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.mesh = refinement, stages, machine_code
        with_unknowns = {unknown.session for unknown in parameters.unknowns}
        members: dict[str, dict[int, Measured]] = {}
        for i, shape in enumerate(self.shapes):
            name = shape.session if shape.session in with_unknowns else ""
            members.setdefault(name, {})[i] = shape
        #: Of each session that has an arm of its own, and of all others.
        self.sessions = [Session(parameters, *item, self.mesh) for item in members.items()]

    def from_rest(self, values: Array, looser: float = 1.0) -> Evaluation:
        """Return all shapes at values (K,) as they are reached from rest.

        InputError where no such arm can be; shapes that have no equilibrium are `lost`.
        """
        parts = []
        for session in self.sessions:
            equations = session.at(values)
            parts.append(Settled.of(equations, equations.from_rest(looser)))
        return Evaluation(self, values, parts)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Shapes at given values (K,) of the unknowns.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    parts : list of Settled
        The shapes of each session.
    """

    experiment: Experiment
    values: Array
    parts: Sequence[Settled]

    def near(self, values: Array, experiment: Experiment | None = None) -> Evaluation:
        """Return the shapes that this has at other values, on the same branches.

        On the meshes of this experiment or of another one of the same shapes; those that do not
        lead to an equilibrium nearby, in a few steps, are `lost`.
        """
        experiment = experiment or self.experiment
        pairs = zip(experiment.sessions, self.parts, strict=True)
        parts = [part.near(session.at(values), _HALVINGS) for session, part in pairs]
        return Evaluation(experiment, values, parts)

    def only(self, kept: Iterable[int]) -> Evaluation:
        """Return the evaluation with all but some shapes left out."""
        which = set(kept)
        return Evaluation(self.experiment, self.values, [part.only(which) for part in self.parts])

    @cached_property
    def equilibria(self) -> dict[int, Linearised]:
        """By the number of their shape, in order; without those left out or lost."""
        return self._joined("equilibria")

    @cached_property
    def lost(self) -> dict[int, OctoplanError]:
        """Why shapes have none, by their number."""
        return {i: why for part in self.parts for i, why in part.lost.items()}

    @cached_property
    def residuals(self) -> dict[int, Array]:
        """Predictions less measurements (size,), [m] and [rad], of each shape by number."""
        return self._joined("residuals")

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Their derivatives by the unknowns (size, K)."""
        return self._joined("jacobians")

    @cached_property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which they are of unit variance, as is known."""
        return self._joined("whitening")

    def scaled(self, noise: float = 1.0) -> dict[int, tuple[Array, Array]]:
        """Return residuals (size,) of each shape over the noise, whitened, and their derivatives.

        By unknowns counted from 0 to 1 (size, K).
        """
        span = self.experiment.parameters.range
        return {
            i: (W @ self.residuals[i] / noise, W @ self.jacobians[i] * span / noise)
            for i, W in self.whitening.items()
        }

    def _joined(self, what: str) -> dict[int, Any]:
        """Return something of all shapes in equilibrium, in their order."""
        parts = [part for part in self.parts if part.equilibria]
        rows = [item for part in parts for item in getattr(part, what).items()]
        return dict(sorted(rows, key=itemgetter(0)))

    def named(self) -> tuple[Residual, ...]:
        """Return all residuals, shape by shape."""
        rows = list[tuple[str, str, Array]]()
        for i, miss in self.residuals.items():
            shape = self.experiment.shapes[i]
            names = [sensor.what for sensor in shape.sensors]
            tendons = [f"{run}[{j}]" for run in shape.runs for j in range(len(getattr(shape, run)))]
            vectors, lengths = np.split(miss, [3 * len(names)])
            rows += zip([shape.name] * len(names), names, vectors.reshape(-1, 3), strict=True)
            rows += zip([shape.name] * len(tendons), tendons, lengths[:, None], strict=True)
        return tuple(Residual(shape, what, tuple(row.tolist())) for shape, what, row in rows)


@dataclass(frozen=True, eq=False)
class Settled:
    """Shapes of a session in equilibrium, and what sensors show of them: of all at once.

    Attributes
    ----------
    equations : Equations
    equilibria : dict of Linearised
        By the number of their shape, in order.
    lost : dict of OctoplanError
        Why others have none.
    """

    equations: Equations
    equilibria: Mapping[int, Linearised]
    lost: Mapping[int, OctoplanError]

    @classmethod
    def of(cls, equations: Equations, reached: Mapping[int, Reached]) -> Settled:
        """Return the shapes that were reached, in order, and those that were not."""
        rows = dict(sorted(reached.items()))
        equilibria = {i: end for i, end in rows.items() if isinstance(end, Linearised)}
        lost = {i: end for i, end in rows.items() if isinstance(end, OctoplanError)}
        return cls(equations, equilibria, lost)

    def only(self, kept: set[int]) -> Settled:
        """Return the shapes that are kept."""
        left = {i: equilibrium for i, equilibrium in self.equilibria.items() if i in kept}
        return Settled(self.equations, left, {})

    def near(self, at: Equations, halvings: int) -> Settled:
        """Return the shapes by equations with other values, or on another mesh.

        The way to other values is halved, so often at most, for those that no step leads to.
        """
        there, here = self._in_one_step(at), self.equations
        if there.lost and halvings and at.session is here.session:
            middle = here.session.at((here.values + at.values) / 2)
            half = self.only(set(there.lost)).near(middle, halvings - 1)
            rest = half.near(at, halvings - 1)
            reached = {**there.lost, **half.lost, **rest.lost}
            there = Settled.of(at, {**reached, **there.equilibria, **rest.equilibria})
        return there

    def _in_one_step(self, at: Equations) -> Settled:
        """Return the shapes where Newton's method leads from where derivatives say that they are.

        Where the mesh is another, from the strains on that.
        """
        change, of = at.values - self.equations.values, at.system.of
        on = None if of is self.equations.system.of else Collocation.on(at.system)
        reached = dict[int, Reached]()
        for i, before in self.equilibria.items():
            shape, states, tensions = at.session.shapes[i], before.states, before.tensions
            if change.any():
                by = self.by_numbers[i]
                states = states + by.states @ change
                tensions = np.maximum(tensions + by.tensions @ change, 0.0)
            T = tensions if shape.by_length else at.tensions(shape)
            guess = on.carried(T, before) if on else states
            turned = np.abs(states - before.states)[before.system.of.nodes[:, :4]].max()
            near = before if on is None and turned < CLOSE else None
            here = newton(at.system, T, 1.0, guess, near=near, looser=_LOOSER)
            reached[i] = at.held(i, here or OctoplanError("it jumps"))
        return Settled.of(at, reached)

    @cached_property
    def by_numbers(self) -> dict[int, ByNumbers]:
        """Derivatives of the equilibria by the unknowns."""
        return self.equations.differentiated(self.equilibria)

    @cached_property
    def residuals(self) -> dict[int, Array]:
        """Predictions less measurements of each shape (size,), [m] and [rad]."""
        shown = self._stacked(self._shown.values, lambda i: self.equilibria[i].lengths)
        return {i: row - self._measured(i).numbers for i, row in shown.items()}

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Derivatives of `residuals` by the unknowns, each (size, K)."""
        derivatives, by, rows = self.equations.derivatives, self.by_numbers, self._rows
        nodes = self.equations.nodes[rows]
        moved = displaced(self._poses, self._at([each.states for each in by.values()]))
        # Of what is looked at, which need not move along with its node.
        slip, heres = derivatives.s[rows] - derivatives.nodes[nodes], list(self.equilibria.values())
        for m in np.flatnonzero(slip.any(axis=1)):
            moved[m] += along(heres[self._of[m]], nodes[m : m + 1])[0][:, None] * slip[m]
        changes = self._shown.changes(moved)
        changes += matrices(self._poses[:, :4]) @ derivatives.offsets[rows]
        return self._stacked(changes, lambda i: by[i].lengths, derivatives.rest)

    @cached_property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which residuals of each shape are of unit variance.

        Noise of what drives a shape, its tensions or its lengths, is carried to the residuals to
        first order: the effective variance. Source: Orear, American Journal of Physics 50 (1982).
        """
        shapes = {i: self._measured(i) for i in self.equilibria}
        if not any(shape.by_length or shape.tension_std for shape in shapes.values()):
            return {i: np.diag(1 / shape.stds) for i, shape in shapes.items()}
        by_tensions = self._at([here.by_tensions for here in self.equilibria.values()])
        changes = self._shown.changes(displaced(self._poses, by_tensions))
        whitening = {}
        lengths = self._stacked(changes, lambda i: self.equilibria[i].length_tension, 0.0)
        for i, J in lengths.items():
            shape, inputs = shapes[i], shapes[i].tension_std * np.diag(self.equations.numbers.scale)
            if shape.by_length:
                std = shape.length_std or shape.std
                inputs = std * tensions_by_lengths(self.equilibria[i])
            variance = np.diag(np.square(shape.stds)) + (J @ inputs) @ (J @ inputs).T
            whitening[i] = np.linalg.inv(np.linalg.cholesky(variance))
        return whitening

    def _measured(self, i: int) -> Measured:
        return self.equations.session.shapes[i]

    @cached_property
    def _rows(self) -> Index:
        """Which of the session's sensors look at these shapes (M,)."""
        return np.flatnonzero(np.isin(self.equations.session.shape, list(self.equilibria)))

    @cached_property
    def _of(self) -> Index:
        """Which of these shapes each looks at (M,)."""
        return np.searchsorted(list(self.equilibria), self.equations.session.shape[self._rows])

    @cached_property
    def _poses(self) -> Array:
        """Poses where they look (M, 7)."""
        return self._at([here.states for here in self.equilibria.values()])

    def _at(self, states: Sequence[Array]) -> Array:
        """Return the rows of poses (M, 7, ...) among states (n_states, ...) of each shape."""
        return np.asarray(np.array(states)[self._of[:, None], self.equations.places[self._rows]])

    @cached_property
    def _shown(self) -> _Shown:
        session, rows = self.equations.session, self._rows
        frames = matrices(self._poses[:, :4])
        levers = np.einsum("mij,mj->mi", frames, self.equations.numbers.offsets[rows])
        shown, of_frame = self._poses[:, 4:] + levers, session.point[rows] == FRAME
        cosines = np.zeros(len(rows))
        if of_frame.any():
            seen = np.array([session.sensors[m].value for m in rows[of_frame]])
            between = Rotation.from_matrix(frames[of_frame] @ seen.transpose(0, 2, 1))
            quaternions = between.as_quat(canonical=True)
            levers[of_frame], cosines[of_frame] = quaternions[:, :3], quaternions[:, 3]
            shown[of_frame] = 2 * levers[of_frame]
        return _Shown(shown, of_frame, cosines, levers)

    def _stacked(
        self, rows: Array, lengths: Callable[[int], Array], rest: Array | float | None = None
    ) -> dict[int, Array]:
        """Return for each shape its rows of (M, 3, ...), then lengths or strokes as it has them."""
        rest, stacks = self.equations.numbers.rest if rest is None else rest, {}
        for k, i in enumerate(self.equilibria):
            parts = [rows[self._of == k].reshape(-1, *rows.shape[2:])]
            for run in self._measured(i).runs:
                parts.append(lengths(i) if run == "lengths" else rest - lengths(i))
            stacks[i] = np.concatenate(parts)
        return stacks


class _Shown(NamedTuple):
    """Places of markers [m], and of frames twice the vector part of the quaternion that is between.

    Of what turns the measured frame into the predicted one. `levers` (M, 3) are from the midline to
    the marker, or that vector part; `cosines` (M,) the quaternion's scalar part, 0 of markers.
    """

    values: Array
    of_frame: NDArray[np.bool_]
    cosines: Array
    levers: Array

    def changes(self, moved: Array) -> Array:
        """Return how these change (M, 3, K) with displacements and rotations (M, 6, K).

        A quaternion (w, v) that is turned by theta changes by (0, theta) (w, v) / 2.
        """
        moves, turns = moved[:, :3], moved[:, 3:]
        shifts = np.where(self.of_frame[:, None, None], 0.0, moves)
        shifts += self.cosines[:, None, None] * turns
        return np.asarray(shifts + np.cross(turns, self.levers[:, :, None], axis=1))
